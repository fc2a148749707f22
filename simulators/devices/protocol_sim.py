"""pyserial's handler of `sim://BENCH/DEVICE`: the host side of a simulated cable."""

from typing import Any

from drivers.transport import PortBase, PortError
from simulators.devices.serial_device import Cable, cable_at


class Serial(PortBase):  # type: ignore[misc] # pyserial has no types
    """A port connected to a simulated device of this process."""

    _cable: Cable | None = None

    def open(self) -> None:
        """Own the cable. Raises PortError."""
        try:
            self._cable = cable_at(str(self.portstr).partition("://")[2])
            self._cable.open(self, self.baudrate)
        except OSError as error:
            raise PortError(str(error)) from error
        self.is_open = True
        self._cable.set_lines(self._rts_state, self._dtr_state)

    def close(self) -> None:
        if self._cable is not None and self.is_open:
            self._cable.close(self)
            self._cable.set_lines(False, False)
        self.is_open = False

    def _there(self) -> Cable:
        if self._cable is None or not self.is_open:
            raise PortError("Attempting to use a port that is not open")
        return self._cable

    @property
    def in_waiting(self) -> int:
        """Bytes that can be read at once."""
        return self._there().waiting()

    def read(self, size: int = 1) -> bytes:
        """Up to `size` bytes; waits up to `timeout` seconds for the first."""
        try:
            return self._there().read(self, size, self.timeout)
        except OSError as error:
            raise PortError(str(error)) from error

    def write(self, data: bytes) -> int:
        """All of `data`, at once. Raises PortError, and TimeoutError where a clogged port takes none."""
        try:
            self._there().write(bytes(data))
        except TimeoutError:
            raise
        except OSError as error:
            raise PortError(str(error)) from error
        return len(data)

    def cancel_read(self) -> None:
        self._there().cancel_read()

    def flush(self) -> None:
        """Nothing is buffered."""

    def reset_input_buffer(self) -> None:
        """Discard received bytes."""
        self._there().read(self, self._there().waiting(), 0.0)

    def reset_output_buffer(self) -> None:
        """Nothing is buffered."""

    def _reconfigure_port(self, *_: Any) -> None:
        """Settings are read when the port is opened."""

    def _update_rts_state(self) -> None:
        self._there().set_lines(self._rts_state, self._dtr_state)

    def _update_dtr_state(self) -> None:
        self._there().set_lines(self._rts_state, self._dtr_state)

    cts = dsr = ri = cd = property(lambda self: False)
