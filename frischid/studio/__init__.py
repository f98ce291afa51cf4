"""The studio: a page on localhost to work in.

The robot moves along the log, its joints coloured by where the model fails. A click on a finding adds its effect,
refits the model and changes curves, colours and staircase before the user's eyes; every step can be undone. The page is
viser's; the figures are those of the report (`frischid.figures`); what is computed is in `frischid.studio.bench`, which
knows no page.
"""

from __future__ import annotations

import contextlib
import io
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from frischid.errors import InputError
from frischid.log import Log
from frischid.model import Model, check_writable


@dataclass(frozen=True, eq=False)
class Studio:
    """A running studio: its server, its bench, and where it is to be found."""

    server: Any
    bench: Any
    address: str

    def stop(self) -> None:
        """Close the page's server."""
        self.server.stop()


def studio(
    model: Model, logs: Sequence[Log], output: str | Path, *, host: str = "127.0.0.1", port: int = 8080
) -> Studio:
    """Start the studio; it runs in the background until it is stopped.

    Parameters
    ----------
    model : Model
    logs : sequence of Log
        Those the model was fitted to are fitted again with every effect added; the others measure the error.
    output : str or Path
        Where the page's button saves the model; the report goes beside it.
    host : str
        Address to listen on. Whoever reaches it can change the model and write `output`: leave it at loopback unless
        you trust the network.
    port : int
        The next free one is taken when it is in use.

    Returns
    -------
    Studio

    Raises
    ------
    InputError
        viser is not installed, or the logs do not fit the model.
    """
    try:
        import viser
    except ImportError:
        raise InputError('the studio needs viser: pip install "frischid[studio]"') from None
    from frischid.studio.bench import Bench
    from frischid.studio.stage import Track
    from frischid.studio.tab import FRAME, Tab

    if not logs:
        raise InputError("there is no log to show")
    check_writable(output)
    with contextlib.redirect_stdout(io.StringIO()):  # viser announces itself; the command prints its own line
        server = viser.ViserServer(host=host, port=port, label="frischid studio", verbose=False)
    try:
        bench = Bench(model, logs, Path(output))
    except Exception:
        server.stop()
        raise
    track = Track.of(bench)
    tabs: dict[int, Tab] = {}

    def everywhere(do: Any) -> None:
        for number, tab in list(tabs.items()):
            try:
                do(tab)
            except Exception:  # a tab that was closed meanwhile must not keep the others from being told
                tabs.pop(number, None)

    @server.on_client_connect
    def _(client: viser.ClientHandle) -> None:
        tab = Tab(client, bench, track)
        tabs[client.client_id] = tab
        tab.refresh()
        bench.look()

    @server.on_client_disconnect
    def _(client: viser.ClientHandle) -> None:
        tabs.pop(client.client_id, None)

    bench.listen(lambda: everywhere(lambda tab: tab.refresh()))
    bench.on_progress(lambda text, share: everywhere(lambda tab: tab.progress(text, share)))

    def play() -> None:
        while True:
            time.sleep(FRAME)
            everywhere(lambda tab: tab.step())

    threading.Thread(target=play, daemon=True, name="frischid play").start()
    threading.Thread(target=_warm, args=(bench,), daemon=True, name="frischid warm").start()
    shown = "localhost" if host in ("127.0.0.1", "localhost", "0.0.0.0") else host
    return Studio(server, bench, f"http://{shown}:{server.get_port()}")


def _warm(bench: Any) -> None:
    """Draw once while the browser still loads the page: plotly and yourdfpy load most of themselves on first use."""
    from frischid import figures
    from frischid.studio.bodies import urdf_of

    state = bench.state
    urdf_of(state.model.robot)
    figures.measured(state.prediction, state.comparison, state.model.joints[0]).figure.to_json()
    figures.matrix(state.comparison)
    figures.staircase(state.model, state.comparison.noise_floor)
