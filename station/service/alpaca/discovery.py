"""Alpaca's discovery protocol: a datagram asks for servers, the answer is the server's port (version 1)."""

import json
import socket
import threading
from contextlib import suppress

from station.service.hosting import bad_address

PORT = 32227
QUESTION = b"alpacadiscovery1"


class Discovery:
    """Answers until closed; other servers on this machine may listen, too. Raises BadParameter if it cannot listen on
    the port."""

    def __init__(self, served_port: int, host: str = "0.0.0.0", port: int = PORT) -> None:
        self._closed = False
        self._answer = json.dumps({"AlpacaPort": served_port}).encode()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise bad_address(host, port, error) from error
        threading.Thread(target=self._listen, name="discovery", daemon=True).start()

    @property
    def port(self) -> int:
        number: int = self._socket.getsockname()[1]
        return number

    def _listen(self) -> None:
        while not self._closed:
            with suppress(OSError):  # closed, or the client is gone already
                data, asker = self._socket.recvfrom(64)
                if data.startswith(QUESTION):
                    self._socket.sendto(self._answer, asker)

    def close(self) -> None:
        """Stop answering."""
        self._closed = True
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as waker:
            waker.sendto(b"", ("127.0.0.1", self.port))
        self._socket.close()
