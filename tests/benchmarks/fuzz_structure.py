"""Mutations that leave a file readable as its format and change what it holds: arrays of another rank, odd numbers."""

import io
import json
import random
from collections.abc import Callable
from typing import Any

import numpy as np

NUMBERS = (float("nan"), float("inf"), -float("inf"), 1e308, -1e308, 1e200, 1e30, 1e-320, 2.0**31, -1.0, 0.0)
LEAVES = (None, True, "x", "", [], {}, [1.0], [[1, 2], [3]], 10**400, 1 << 63, 1e308, -1e308, 1e200, 1e-320, -1, 0, 0.5)


def spoilt_array(array: np.ndarray, rng: random.Random) -> np.ndarray:
    """Another rank, another length, another type, or an odd number in it."""
    return rng.choice((_rank, _length, _type, _number, _number, _scale))(array, rng)


def _rank(array: np.ndarray, rng: random.Random) -> np.ndarray:
    flat = array.ravel()
    return rng.choice((array[None], array[..., None], flat, flat[:1].reshape(()), flat.reshape(1, -1), array.T[0]))


def _length(array: np.ndarray, rng: random.Random) -> np.ndarray:
    axis, n = rng.randrange(array.ndim), rng.choice((0, 1, 2, 3))
    kept = np.take(array, range(min(n, array.shape[axis])), axis)
    return rng.choice((kept, np.concatenate([array, kept], axis)))


def _type(array: np.ndarray, rng: random.Random) -> np.ndarray:
    with np.errstate(all="ignore"):
        return array.astype(rng.choice(("?", "i1", "u8", "f2", ">f4", "c16", "U3", "g")))


def _number(array: np.ndarray, rng: random.Random) -> np.ndarray:
    changed = array.astype(np.float64)
    changed.flat[rng.randrange(array.size)] = rng.choice(NUMBERS)
    return changed


def _scale(array: np.ndarray, rng: random.Random) -> np.ndarray:
    with np.errstate(all="ignore"):
        return array.astype(np.float64) * rng.choice((0.0, -1.0, 1e-320, 1e29, 1e100, 1e300, 1e308))


def _npy(data: bytes, rng: random.Random) -> bytes:
    file = io.BytesIO()
    np.save(file, spoilt_array(np.load(io.BytesIO(data)), rng))
    return file.getvalue()


def _npz(data: bytes, rng: random.Random) -> bytes:
    arrays, file = dict(np.load(io.BytesIO(data))), io.BytesIO()
    name = rng.choice(sorted(arrays))
    np.savez(file, **{**arrays, name: spoilt_array(arrays[name], rng)})
    return file.getvalue()


def _hdf5(data: bytes, rng: random.Random) -> bytes:
    import h5py

    content = io.BytesIO(data)
    with h5py.File(content, "r+") as file:
        names: list[str] = []
        file.visit(names.append)
        name = rng.choice(names)
        attributes = file[name].attrs
        if attributes and rng.random() < 0.3:
            attributes[rng.choice(sorted(attributes))] = rng.choice((*NUMBERS, "x", -3, 0, 1 << 40, [1.0, 2.0, 3.0]))
        elif isinstance(file[name], h5py.Dataset) and file[name].dtype.kind != "O":
            array = spoilt_array(file[name][()], rng)
            del file[name]
            if array.dtype.kind != "U":
                file[name] = array
        else:
            del file[name]
    return content.getvalue()


def _json(data: bytes, rng: random.Random) -> bytes:
    content = json.loads(data)
    places = list(_places(content))
    holder, key = rng.choice(places)
    if rng.random() < 0.1:
        del holder[key]
    else:
        holder[key] = rng.choice((*LEAVES, [holder[key]]))
    return json.dumps(content).replace("Infinity", "1e999").encode()


def _places(content: Any) -> Any:
    keys = range(len(content)) if isinstance(content, list) else content if isinstance(content, dict) else ()
    for key in keys:
        yield content, key
        yield from _places(content[key])


STRUCTURED: dict[str, Callable[[bytes, random.Random], bytes]] = {
    ".npy": _npy,
    ".npz": _npz,
    ".h5": _hdf5,
    ".json": _json,
}


def restructured(data: bytes, suffix: str, rng: random.Random) -> bytes:
    """The content with one thing in it changed; as it is where it cannot be read any more."""
    try:
        return STRUCTURED[suffix](data, rng)
    except Exception:
        return data
