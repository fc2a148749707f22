"""Foreign packages on Python's path that have the name of one of the project's."""

from importlib.util import find_spec
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def check_namesakes() -> None:
    """End the program with the reason and the remedy where Python would load another package of the same name."""
    for name in ("procedures", "drivers", "simulators"):
        spec = find_spec(name)
        places = [] if spec is None else [*(spec.submodule_search_locations or []), spec.origin or ""]
        if places and ROOT / name not in [Path(place).resolve() for place in places]:
            raise SystemExit(
                f"Error: Python finds another package `{name}` in {places[0]}, before the station's own in {ROOT}; "
                "rename it, remove its folder from PYTHONPATH, or run the command in another folder"
            )
