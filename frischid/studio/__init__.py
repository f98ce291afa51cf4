"""The studio: a page on localhost to work in.

The robot moves along the log, its joints coloured by where the model fails. A click on a finding adds its effect,
refits the model and changes curves, colours and staircase before the user's eyes; every step can be undone. The page is
viser's; the figures are those of the report (`frischid.figures`); the computations are in `frischid.studio.bench`,
which knows no page.

The page opens before anything is computed: a browser takes as long to read viser's scripts as the model
takes to be evaluated along its logs, and the two go on side by side. Hence this module imports little at its top.
"""

from __future__ import annotations

import contextlib
import io
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from frischid.errors import InputError
from frischid.studio.frame import Frame

if TYPE_CHECKING:
    from frischid.logs.log import Log
    from frischid.model.model import Model
    from frischid.studio.bench import Bench
    from frischid.studio.tab import Tab

FRAME = 0.05  # s between two poses of a robot that plays


class Studio:
    """A page that is served, at first without a model: `show` puts one on it.

    Parameters
    ----------
    host : str
        Address to listen on. Whoever reaches it can change the model and write its file: leave it at loopback unless
        you trust the network.
    port : int
        The next free one is taken when it is in use.

    Attributes
    ----------
    address : str
        Where it is to be found.
    bench : Bench
        Once there is a model.
    tabs : dict of int to Tab
        The browser tabs that show it, by viser's number of the client.

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
            raise InputError('the studio needs viser: pip install "frischid[studio]"') from None
        with contextlib.redirect_stdout(io.StringIO()):  # viser announces itself; the command prints its own line
            self.server = viser.ViserServer(host=host, port=port, label="frischid studio", verbose=False)
        # Lit by two lamps and the sky: without a GPU, viser's picture of a warehouse and its shadows take seconds.
        self.server.scene.configure_environment_map(None)
        self.server.scene.configure_default_lights(cast_shadow=False)
        self.server.scene.add_light_hemisphere("/sky", ground_color=(150, 150, 150), intensity=2.0)
        shown = "localhost" if host in ("127.0.0.1", "localhost", "0.0.0.0") else host
        self.address = f"http://{shown}:{self.server.get_port()}"
        self._lock = threading.Lock()  # over who waits and who is shown the model
        self._waiting: dict[int, Frame] = {}
        self.tabs: dict[int, Tab] = {}
        self._open: Callable[[Frame], None] | None = None
        self.server.on_client_connect(self._arrived)
        self.server.on_client_disconnect(self._left)

    def show(self, model: Model, logs: Sequence[Log], output: str | Path) -> None:
        """Put a model on the page, and work on it until the studio is stopped.

        Parameters
        ----------
        model : Model
        logs : sequence of Log
            Those the model was fitted to are fitted again with every effect added; the others measure the error.
        output : str or Path
            Where the page's button saves the model; the report goes beside it.

        Raises
        ------
        InputError
            The logs do not fit the model, or `output` cannot be written.
        """
        from frischid.core.files import check_writable
        from frischid.studio.bench import Bench
        from frischid.studio.tab import Tab
        from frischid.studio.track import Track

        if not logs:
            raise InputError("there is no log to show")
        check_writable(output)
        bench = self.bench = Bench(model, logs, Path(output))
        track = Track.of(bench)

        def show(frame: Frame) -> None:
            tab = self.tabs[frame.client.client_id] = Tab(frame, bench, track)
            tab.refresh()  # what changed while it was drawn
            bench.look()

        with self._lock:
            self._open = show
            waiting, self._waiting = list(self._waiting.values()), {}
        bench.listen(lambda: self._everywhere(lambda tab: tab.refresh()))
        bench.on_progress(lambda text, share: self._everywhere(lambda tab: tab.progress(text, share)))
        for frame in waiting:
            show(frame)
        threading.Thread(target=self._play, daemon=True, name="frischid play").start()

    def stop(self) -> None:
        """Close the page's server."""
        with contextlib.redirect_stdout(io.StringIO()):  # viser takes its leave
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
            except Exception:  # a tab that was closed meanwhile must not keep the others from being told
                self.tabs.pop(number, None)

    def _play(self) -> None:
        while True:
            time.sleep(FRAME)
            self._everywhere(lambda tab: tab.step(FRAME))


def studio(
    model: Model, logs: Sequence[Log], output: str | Path, *, host: str = "127.0.0.1", port: int = 8080
) -> Studio:
    """Start the studio on a model; it runs in the background until it is stopped.

    Parameters and errors are those of `Studio` and `Studio.show`.
    """
    running = Studio(host, port)
    with contextlib.ExitStack() as unless_shown:
        unless_shown.callback(running.stop)
        running.show(model, logs, output)
        unless_shown.pop_all()
    return running
