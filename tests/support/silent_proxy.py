"""A proxy before PostgreSQL that falls silent after some bytes, as a cable that is pulled."""

import socket
import threading
from contextlib import suppress
from types import TracebackType
from typing import Self
from urllib.parse import parse_qs, urlsplit


class SilentProxy:
    """Forwards connections to a server's socket, until it is cut: then it is silent for good."""

    def __init__(self, url: str) -> None:
        parts = urlsplit(url)
        query = parse_qs(parts.query)
        self._target = f"{query['host'][0]}/.s.PGSQL.5432"
        self._listener = socket.create_server(("127.0.0.1", 0))
        port = self._listener.getsockname()[1]
        options = "".join(f"&options={value.replace(' ', '%20')}" for value in query.get("options", []))
        self.url = (
            f"postgresql://postgres@127.0.0.1:{port}{parts.path}?sslmode=disable&gssencmode=disable{options}"
        )
        self.sent = 0  # bytes from the clients so far
        self._left: int | None = None
        self._lock = threading.Lock()
        self._sockets: list[socket.socket] = []
        self._is_silent: set[socket.socket] = set()
        threading.Thread(target=self._accept, daemon=True).start()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _type: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        for each in [self._listener, *self._sockets]:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    def cut_after(self, count: int) -> None:
        """Forward so many bytes from the clients that are connected, and nothing afterwards."""
        with self._lock:
            self._left = count
            self._is_silent = set(self._sockets)

    def close_silent(self) -> None:
        """Close the connections that are silent, as the system does after a time without a sign of life."""
        with self._lock:
            silent, self._is_silent = self._is_silent, set()
            self._sockets = [each for each in self._sockets if each not in silent]
        for each in silent:
            with suppress(OSError):
                each.shutdown(socket.SHUT_RDWR)
            each.close()

    @property
    def is_cut(self) -> bool:
        """True once all bytes were forwarded."""
        return self._left == 0

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                client, _ = self._listener.accept()
                server = socket.socket(socket.AF_UNIX)
                server.connect(self._target)
                self._sockets += [client, server]
                for ends in ((client, server, True), (server, client, False)):
                    threading.Thread(target=self._forward, args=ends, daemon=True).start()

    def _forward(self, source: socket.socket, target: socket.socket, is_upward: bool) -> None:
        with suppress(OSError):
            while content := source.recv(16_384):
                with self._lock:
                    if source in self._is_silent and self._left is not None:
                        if is_upward:
                            content, self._left = content[: self._left], max(0, self._left - len(content))
                        elif self._left == 0:
                            content = b""
                    if is_upward:
                        self.sent += len(content)
                if content:
                    target.sendall(content)
            # The end of one side is not told the other either once the proxy is silent.
            if not (source in self._is_silent and self._left == 0):
                target.shutdown(socket.SHUT_WR)
