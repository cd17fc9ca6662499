"""A page in headless Chromium: serves a folder to it on this machine alone and takes the JSON that it posts back."""

import json
import shutil
import subprocess
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from threading import Event, Thread

import pytest

FLAGS = (
    "--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader", "--force-color-profile=srgb", "--no-first-run",
)  # fmt: skip
SECONDS = 180


class Answers(ThreadingHTTPServer):
    """Serves one folder and keeps what is posted."""

    def __init__(self, folder: Path) -> None:
        self.answer: dict[str, object] = {}
        self.is_answered = Event()
        super().__init__(("127.0.0.1", 0), lambda *words: Handler(*words, directory=str(folder)))


class Handler(SimpleHTTPRequestHandler):
    """Files of one folder, without a word on stderr; POST is the page's answer."""

    server: Answers

    def do_POST(self) -> None:
        self.server.answer = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(204)
        self.end_headers()
        self.server.is_answered.set()

    def log_message(self, format: str, *arguments: object) -> None:
        pass


def page(folder: Path, name: str, profile: Path) -> dict[str, object]:
    """Open FOLDER/NAME and give the JSON that the page posts."""
    program = shutil.which("chromium") or shutil.which("google-chrome")
    if program is None:
        pytest.skip("Chromium is not installed")
    server = Answers(folder)
    Thread(target=server.serve_forever, daemon=True).start()
    address = f"http://127.0.0.1:{server.server_port}/{name}"
    words = [program, *FLAGS, f"--user-data-dir={profile}", address]
    browser = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        assert server.is_answered.wait(SECONDS), "the page gave no answer"
    finally:
        browser.terminate()
        browser.wait(30)
        server.shutdown()
        server.server_close()
    return server.answer
