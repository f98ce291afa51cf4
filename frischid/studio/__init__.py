"""The studio: a page on localhost to work in.

The robot moves along the log; the colour of a joint shows the model's error there. A click on a finding adds its
effect, refits the model and updates curves, colours and the history of errors; every step can be undone. The page is
made with viser; the figures are those of the report (`frischid.figures`); the computations are in
`frischid.studio.bench`, which does not depend on the page.

The page opens before anything is computed, because a browser takes as long to load viser's scripts as the model takes
to be evaluated along its logs. Both then run at the same time. So this module imports little at its top.
"""

from __future__ import annotations

import contextlib
import io
import threading
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frischid.core.extras import install_command
from frischid.errors import InputError
from frischid.studio.frame import Frame
from frischid.studio.gate import Gate

if TYPE_CHECKING:
    from frischid.logs.given import Logs
    from frischid.logs.mapping import MappingLike
    from frischid.model.model import Model
    from frischid.studio.bench import Bench
    from frischid.studio.tab import Tab

FRAME = 0.05  # s between two poses of a moving robot
PIXELS = "fixedDpr=1"
"""Part of the address: viser draws the scene with one dot per CSS pixel, so a dense screen shows it less sharp.

Without this part, viser reports the scene's size in dots of the screen, one to three per CSS pixel, and changes their
number while the browser is slow: then a telephone looks as wide as a desk's screen."""


class Studio:
    """A served page. At first it has no model; `show` puts one on the page.

    Parameters
    ----------
    host : str
        Address to listen on. Anybody who knows `address` and reaches the page can change the model and write its file.
        The address crosses the network unencrypted: keep the loopback address unless you trust the network.
    port : int
        Port to listen on; if it is in use, the next free one is taken.

    Attributes
    ----------
    address : str
        Address of the page, with the secret token that lets a browser in.
    bench : Bench
        The model and its logs, after `show`.
    tabs : dict of int to Tab
        The browser tabs that show the page, by viser's number of the client.

    Raises
    ------
    InputError
        viser is not installed.
    """

    bench: Bench

    def __init__(self, host: str = "127.0.0.1", port: int = 8080) -> None:
        try:
            import viser
        except ImportError:
            raise InputError(f"the studio needs viser: {install_command('studio')}") from None
        gate = Gate(host)
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints an announcement; the command prints its own line
            self.server = gate.opened(lambda: viser.ViserServer(host, port, label="frischid studio", verbose=False))
        # Two lamps and the sky light the scene: without a GPU, viser's default surroundings and shadows take seconds.
        self.server.scene.configure_environment_map(None)
        self.server.scene.configure_default_lights(cast_shadow=False)
        self.server.scene.add_light_hemisphere("/sky", ground_color=(150, 150, 150), intensity=2.0)
        shown = "localhost" if host in ("127.0.0.1", "localhost", "::1", "0.0.0.0", "::") else host
        self.address = f"http://{shown}:{self.server.get_port()}/{gate.token}?{PIXELS}"
        self._lock = threading.Lock()  # guards the lists of tabs that wait and tabs that show the model
        self._waiting: dict[int, Frame] = {}
        self.tabs: dict[int, Tab] = {}
        self._open: Callable[[Frame], None] | None = None
        self._stopped = threading.Event()
        self.server.on_client_connect(self._arrived)
        self.server.on_client_disconnect(self._left)

    def show(self, model: Model, logs: Logs, output: str | Path, mapping: MappingLike = None) -> None:
        """Put a model on the page, and work on it until the studio is stopped.

        Parameters
        ----------
        logs : sequence of Log or data frame, or one data frame
            Logs the model was fitted to are fitted again with every added effect; the others only measure the error.
        output : str or Path
            File in which the page's button saves the model; the report is written into the same folder.
        mapping : LogMap, mapping or path of a TOML file, optional
            Names and units of the columns of data frames.

        Raises
        ------
        InputError
            The logs do not fit the model, or `output` cannot be written.
        """
        from frischid.core.files import check_writable
        from frischid.logs.given import whole_logs
        from frischid.studio.bench import Bench
        from frischid.studio.tab import Tab
        from frischid.studio.track import Track

        data = whole_logs(logs, model.robot.joints, mapping)
        if not data:
            raise InputError("there is no log to show; give at least one")
        check_writable(output)
        bench = self.bench = Bench(model, data, Path(output))
        track = Track.of(bench)

        def show(frame: Frame) -> None:
            tab = self.tabs[frame.client.client_id] = Tab(frame, bench, track)
            tab.draw()
            if frame.client.client_id not in self.server.get_clients():  # it was closed while the tab was drawn
                self.tabs.pop(frame.client.client_id, None)
                return
            tab.refresh()  # shows changes that came while the tab was drawn
            bench.look()

        with self._lock:
            self._open = show
            waiting, self._waiting = list(self._waiting.values()), {}
        bench.listen(lambda: self._everywhere(lambda tab: tab.refresh()))
        bench.on_progress(lambda text, share: self._everywhere(lambda tab: tab.progress(text, share)))
        bench.on_ranked(lambda ranking: self._everywhere(lambda tab: tab.findings.ranked(ranking)))
        if waiting:
            bench.look(delay=0.0)  # while the browser, another process, draws
        for frame in waiting:
            show(frame)
        threading.Thread(target=self._play, daemon=True, name="frischid play").start()

    def stop(self) -> None:
        """Close the page's server, and end the threads that work for the page."""
        self._stopped.set()
        if hasattr(self, "bench"):
            self.bench.close()
        with contextlib.redirect_stdout(io.StringIO()):  # viser prints a farewell
            self.server.stop()

    def _arrived(self, client: Any) -> None:
        frame = Frame(client)
        with self._lock:
            show = self._open
            if show is None:
                self._waiting[client.client_id] = frame
        if show is not None:
            show(frame)

    def _left(self, client: Any) -> None:
        with self._lock:
            self._waiting.pop(client.client_id, None)
        self.tabs.pop(client.client_id, None)

    def _everywhere(self, do: Callable[[Tab], None]) -> None:
        for number, tab in list(self.tabs.items()):
            try:
                do(tab)
            except Exception:  # viser's errors for a tab that was closed meanwhile have no common class
                if number in self.server.get_clients():  # the tab is open: the error is ours, and is shown
                    traceback.print_exc()
                self.tabs.pop(number, None)

    def _play(self) -> None:
        while not self._stopped.wait(FRAME):
            self._everywhere(lambda tab: tab.step(FRAME))


def studio(
    model: Model,
    logs: Logs,
    output: str | Path,
    *,
    host: str = "127.0.0.1",
    port: int = 8080,
    mapping: MappingLike = None,
) -> Studio:
    """Start the studio on a model; it runs in the background until it is stopped.

    Parameters and errors are those of `Studio` and `Studio.show`.
    """
    running = Studio(host, port)
    with contextlib.ExitStack() as unless_shown:
        unless_shown.callback(running.stop)
        running.show(model, logs, output, mapping)
        unless_shown.pop_all()
    return running
