"""The frame of a page before there is a model: empty panels in their places, and one line of text.

A browser takes a good part of a second to move the panels and to fit the scene between them, and another second to load
the library of the curves. It does both while the model is read and evaluated.
"""

from __future__ import annotations

from typing import Any

from plotly.graph_objects import Figure

READING = "Reading the logs …"
WIDTH = 430  # pixels of each panel
SHEETLESS = 0.4  # share of a phone's height that stays free above the sheet
PHONE = 576  # pixels: below this width viser shows the panels as sections of one sheet at the bottom
STYLE = """<style>
:root { --mantine-color-dimmed: #555 !important; }
.mantine-Notification-description { color: #333 !important; }
@media (max-width: 36em) {
  .mantine-Paper-root[style*="width: 20em"], .mantine-Paper-root [style*="width: 20em"] { width: 100vw !important; }
}
@media (prefers-color-scheme: dark) {
  html { background: #fff; filter: invert(0.91) hue-rotate(180deg); }
  canvas { filter: invert(1) hue-rotate(180deg); }
}
</style>"""
"""Changes of viser's look. Grey text is dark enough to read. On a phone the sheet is as wide as the page, not two
thirds of it. If the reader prefers dark pages, light and dark are exchanged and hues stay, because viser's own dark
colours do not follow the reader's choice. The scene, which has no background of its own, is exchanged back."""


class Frame:
    """Panels of one browser tab, still empty.

    Attributes
    ----------
    phone : bool
        Whether the page is so narrow that the panels are sections of a sheet.
    free : tuple of float
        Width and height (from above) of the part that no panel covers, as shares of the page's height.
    headline, motion : handles
        The text at the top of the right panel, and the content of the left one.
    primer : handle
        A figure that nobody sees: the browser loads the library of the curves for it.
    """

    def __init__(self, client: Any) -> None:
        self.client, gui = client, client.gui
        # Pixels of the whole page, before the panels cover parts of the scene.
        width, height = client.camera.image_width, client.camera.image_height
        self.phone = width < PHONE
        between = max(width - 2 * WIDTH, 0.2 * width)
        self.free = (width / height, SHEETLESS) if self.phone else (between / height, 1.0)
        gui.add_html(STYLE)
        gui.configure_theme(control_width="large", show_logo=False, show_share_button=False)
        gui.set_panel_label("frischid")
        gui.main_panel.dock_right()
        gui.main_panel.set_width(WIDTH)
        self.headline = gui.add_markdown(READING)
        panel = gui.add_panel()
        self.motion = panel.add_tab("Motion")
        panel.dock_left()
        panel.set_width(WIDTH)
        self.primer = gui.add_plotly(Figure(), visible=False)
