"""What the tests do with the client's devices."""

import inspect
import threading


def once(holds):
    """Wait until it is so, and return what it is."""
    while not (found := holds()):
        threading.Event().wait(0.005)  # the bench needs the processor too
    return found


def homed(rail):
    rail.Action("Home", "")
    once(lambda: not rail.IsMoving)
    return rail


def members(device_class):
    """Names of what a device of the client has: (read, called or written)."""
    found = [(name, one) for name, one in inspect.getmembers(device_class) if not name.startswith("_")]
    read = {name for name, one in found if isinstance(one, property)}
    written = {name for name, one in found if isinstance(one, property) and one.fset is not None}
    return read, written | {name for name, one in found if inspect.isfunction(one)}


def beside(work):
    """Do this in a thread; what it raised stands in the list when it has ended."""
    outcome = []

    def run():
        try:
            outcome.append(work())
        except Exception as error:
            outcome.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    return thread, outcome
