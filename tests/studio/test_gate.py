"""The studio's gate: pages of other origins, foreign names and guessed addresses are refused; also in a browser."""

import http.client
import json
import threading
from contextlib import closing
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import urlsplit

import pytest
from browser import SOLID, needs_browser, opened
from listening import listening, needs_ss

from frischid.errors import InputError

pytest.importorskip("viser", reason="the extra frischid[studio] is not installed")

import viser
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from frischid.studio import Studio
from frischid.studio.gate import Gate

PROTOCOL = f"viser-v{viser.__version__}"


@pytest.fixture(scope="module")
def running():
    """A studio that waits for its model: whoever gets here gets everywhere."""
    studio = Studio(port=8400)
    yield studio
    studio.stop()


def shaken(address, **headers):
    """Whether a WebSocket handshake is accepted."""
    try:
        with connect(address.replace("http://", "ws://"), subprotocols=[PROTOCOL], compression=None, **headers):
            return True
    except InvalidStatus as refused:
        if refused.response.status_code != 403:
            raise
        return False


def fetched(address, headers):
    """Status and text of an HTTP request; the header Host is ours to choose."""
    url = urlsplit(address)
    with closing(http.client.HTTPConnection("127.0.0.1", url.port, timeout=300)) as connection:
        connection.putrequest("GET", url.path, skip_host=True)
        for name, value in headers:
            connection.putheader(name, value)
        connection.endheaders()
        answer = connection.getresponse()
        return answer.status, answer.read().decode(errors="replace"), answer


def test_the_owners_page_comes_in(running):
    url = urlsplit(running.address)
    assert shaken(running.address, origin=f"http://{url.netloc}")
    assert shaken(running.address)  # a program that was told the address
    status, text, answer = fetched(running.address, [("Host", url.netloc)])
    assert (status, "<html" in text) == (200, True)
    assert answer.headers["Content-Security-Policy"] == "frame-ancestors 'none'"
    assert answer.headers["Referrer-Policy"] == "no-referrer"
    forwarded = [("Host", "localhost:9999"), ("Origin", "http://localhost:9999")]  # by ssh -L 9999:localhost:8400
    assert fetched(running.address, forwarded)[0] == 200


@pytest.mark.parametrize(
    "origin",
    ["https://example.org", "http://localhost:1", "http://localhost", "null", "file://", "http://127.0.0.1:8400", ""],
)
def test_another_origin_is_refused_though_it_knows_the_address(running, origin):
    assert not shaken(running.address, additional_headers={"Origin": origin})
    netloc = urlsplit(running.address).netloc
    assert fetched(running.address, [("Host", netloc), ("Origin", origin)])[0] == 403


@pytest.mark.parametrize("host", ["example.org", "localhost.example.org:8400", "127.0.0.1.nip.io", "[::1", "", "a b"])
def test_a_foreign_name_is_refused_though_it_leads_here(running, host):
    status, text, _ = fetched(running.address, [("Host", host)])
    assert (status, "<html" in text) in ((403, False), (400, False))
    assert fetched(running.address, [("Host", "localhost"), ("Host", "example.org")])[0] in (400, 403)
    assert fetched(running.address, [])[0] in (400, 403)


@pytest.mark.parametrize(
    "path", ["/", "/index.html", "//", "/wrong", "/wrong/TOKEN", "/?TOKEN", "/TOKEN2", "/%2e/TOKEN"]
)
def test_nothing_is_served_without_the_token(running, path):
    base, token = running.address.partition("?")[0].rsplit("/", 1)
    address = base + path.replace("TOKEN", token)
    assert not shaken(address)
    assert fetched(address, [("Host", urlsplit(base).netloc)])[0] == 403


def test_every_studio_has_another_token():
    assert len({Gate("127.0.0.1").token for _ in range(100)}) == 100
    assert min(len(Gate("127.0.0.1").token) for _ in range(100)) >= 20


def test_a_viser_that_opens_its_server_in_another_way_is_stopped():
    stopped = []

    class Other:
        def stop(self):
            stopped.append(True)

    with pytest.raises(InputError, match="cannot refuse pages of other sites"):
        Gate("127.0.0.1").opened(Other)
    assert stopped == [True]


@needs_ss
def test_it_listens_on_loopback_alone(running):
    assert set(listening()) == {"127.0.0.1"}


HOSTILE = """<!doctype html><title>a page of another origin</title><script>
const address = ADDRESS, socket = (url) => new Promise((done) => {
  const ws = new WebSocket(url.replace("http:", "ws:"), ["PROTOCOL"]);
  ws.onopen = () => done("open"); ws.onerror = () => done("refused");
});
const read = (url, options) => fetch(url, options).then((r) => r.text()).catch(() => "refused");
const framed = (url) => new Promise((done) => {
  const frame = document.createElement("iframe");
  frame.onload = () => { try { done(frame.contentDocument === null ? "opaque" : "readable"); }
    catch (e) { done("opaque"); } };
  frame.src = url; document.body.append(frame);
});
window.onload = async () => {
  const root = new URL("/", address).href;
  window.result = {
    guessed: await socket(root), known: await socket(address),
    numbers: await socket(address.replace("localhost", "127.0.0.1")),
    text: await read(root), page: await read(address), post: await read(address, {method: "POST", body: "x"}),
    framed: await framed(address),
  };
};
</script><body></body>"""


@needs_browser
def test_a_real_page_of_another_origin_gets_nothing(running):
    page = HOSTILE.replace("ADDRESS", json.dumps(running.address)).replace("PROTOCOL", PROTOCOL).encode()

    class Other(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page)

        def log_message(self, *_):
            pass

    other = ThreadingHTTPServer(("127.0.0.1", 0), Other)
    threading.Thread(target=other.serve_forever, daemon=True).start()
    arrived = []
    running.server.on_client_connect(lambda client: arrived.append(client))
    try:
        with opened(f"http://localhost:{other.server_port}/", flags=SOLID) as seen:
            seen.page.wait_for_function("window.result")
            result = seen.page.evaluate("window.result")
    finally:
        other.shutdown()
        other.server_close()
    assert set(result.values()) == {"refused", "opaque"}
    assert result["framed"] == "opaque"
    assert arrived == []
