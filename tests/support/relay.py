"""A way between two processes that a test can interrupt, while both ends stay."""

import contextlib
import socket
import threading


class Relay:
    """Passes on all bytes between who connects to `port` of loopback and `place`."""

    def __init__(self, place):
        self._place = place
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port = self._listening.getsockname()[1]
        self._open = []
        self._joined = True
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self):
        with contextlib.suppress(OSError):
            while True:
                near, _ = self._listening.accept()
                if not self._joined:
                    near.close()
                    continue
                far = socket.create_connection(self._place)
                self._open += [near, far]
                for pair in ((near, far), (far, near)):
                    threading.Thread(target=self._pass_on, args=pair, daemon=True).start()

    @staticmethod
    def _pass_on(source, target):
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 16):
                target.sendall(data)
        for end in (source, target):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def cut(self):
        """End all connections, and new ones at once."""
        self._joined = False
        for end in self._open:
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def join(self):
        """Pass on new connections again."""
        self._joined = True

    def close(self):
        self._listening.close()
        self.cut()
