"""An object store as a process of its own, and a network that fails between it and whoever asks."""

import http.client
import random
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

BUCKET = "depot"
#: What can go wrong with an answer. `lost`, `cut` and `short` come after the store has done what was asked.
FAULTS = ("500", "503", "lost", "cut", "short", "hang", "slow")
#: Seconds that a client of the tests waits for an answer.
PATIENCE = 2
#: Moto wants to see a signature, and does not check it.
SIGNED = "AWS4-HMAC-SHA256 Credential=who/20260101/us-east-1/s3/aws4_request, SignedHeaders=host, Signature=0"


@contextmanager
def moto() -> Iterator[int]:
    """The port of a store with one empty bucket. The test is skipped where moto is not installed."""
    pytest.importorskip("moto.server", reason="no moto here (pip install 'moto[server]')")
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = [sys.executable, "-m", "moto.server", "-H", "127.0.0.1", "-p", str(port)]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        end = time.monotonic() + 60
        while True:
            try:
                assert ask(port, "PUT", f"/{BUCKET}")[0] == 200
                break
            except OSError:
                assert process.poll() is None and time.monotonic() < end, "moto does not answer"
                time.sleep(0.1)
        yield port
    finally:
        process.kill()
        process.wait()


def ask(port: int, method: str, path: str, body: bytes = b"", headers: dict | None = None) -> tuple[int, list, bytes]:
    """One request, as it is: status, headers, and body of its answer."""
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=60)
    try:
        connection.putrequest(method, path, skip_host=headers is not None, skip_accept_encoding=True)
        for name, value in (headers or {"Content-Length": str(len(body)), "Authorization": SIGNED}).items():
            connection.putheader(name, value)
        connection.endheaders(body or None)
        answer = connection.getresponse()
        return answer.status, answer.getheaders(), answer.read()
    finally:
        connection.close()


class Network(ThreadingHTTPServer):
    """What stands between a client and a store: counts, and now and then fails. Its faults are those of a seed."""

    daemon_threads = True

    def __init__(self, store: int, faults: tuple[str, ...] = (), share: float = 0.0):
        super().__init__(("127.0.0.1", 0), _Handler)
        self.store, self.faults, self.share = store, faults, share
        self.random = random.Random(11)
        self.lock = threading.Lock()
        #: Method, path, bytes of the answer's body, fault.
        self.asked: list[tuple[str, str, int, str | None]] = []
        self.thread = threading.Thread(target=self.serve_forever, daemon=True)
        self.thread.start()

    @property
    def environment(self) -> dict[str, str]:
        """What has a program go through this network."""
        return {
            "AWS_ENDPOINT_URL": f"http://127.0.0.1:{self.server_address[1]}", "AWS_ALLOW_HTTP": "true",
            "AWS_ACCESS_KEY_ID": "who", "AWS_SECRET_ACCESS_KEY": "secret", "AWS_REGION": "us-east-1",
            "AWS_TIMEOUT": f"{PATIENCE}s",
        }

    def fault(self) -> str | None:
        with self.lock:
            return self.random.choice(self.faults) if self.random.random() < self.share else None

    @property
    def bytes(self) -> int:
        """Bytes that were sent to the client."""
        return sum(asked[2] for asked in self.asked)

    @property
    def failed(self) -> int:
        return sum(asked[3] is not None for asked in self.asked)

    def handle_error(self, request: object, client_address: object) -> None:
        """A client that was killed."""

    def __enter__(self) -> "Network":
        return self

    def __exit__(self, *_: object) -> None:
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    server: Network

    def log_message(self, *_: object) -> None:
        pass

    def handle_one(self) -> None:
        body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        fault = self.server.fault()
        if fault == "hang":
            time.sleep(PATIENCE + 1)
        if fault in ("500", "503", "hang"):
            status = 503 if fault == "503" else 500
            code = "SlowDown" if fault == "503" else "InternalError"
            headers, data = [("Content-Type", "application/xml")], f"<Error><Code>{code}</Code></Error>".encode()
        else:
            if fault == "slow":
                time.sleep(PATIENCE / 4)
            status, headers, data = ask(self.server.store, self.command, self.path, body, dict(self.headers.items()))
        length, sent = len(data), len(data)
        if self.command == "HEAD":
            length = int(dict(headers).get("Content-Length", 0))
        elif fault == "cut":
            sent //= 2
        elif fault == "short":
            length = sent = sent // 2
        with self.server.lock:
            self.server.asked.append((self.command, self.path, sent, fault))
        if fault == "lost":
            self.close_connection = True
            return
        self.send_response_only(status)
        for name, value in headers:
            if name.lower() not in ("content-length", "connection", "transfer-encoding"):
                self.send_header(name, value)
        self.send_header("Content-Length", str(length))
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(data[:sent])
        if fault == "cut":
            self.close_connection = True

    do_GET = do_PUT = do_POST = do_HEAD = do_DELETE = handle_one
