"""The GLB container: a JSON tree and one binary chunk that is collected in a file, not in memory.

Khronos, glTF 2.0 specification, sections 3.6 (accessors) and 4 (GLB). Little endian; every array starts at a multiple
of four bytes.
"""

import json
import shutil
import struct
from pathlib import Path
from typing import Any

import numpy as np

COMPONENTS = {"f": 5126, "H": 5123, "I": 5125}
KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4"}
ARRAY_BUFFER, ELEMENT_BUFFER = 34962, 34963


class Binary:
    """Arrays on their way into a GLB file, with the bufferViews and accessors that name them."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("wb")
        self.views: list[dict[str, Any]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: np.ndarray, target: int | None = None, with_bounds: bool = False) -> int:
        """Append an array as an accessor of its own bufferView; give the accessor's number."""
        return self.add_to(self.begin(target, array), array, with_bounds)

    def begin(self, target: int | None, example: np.ndarray, is_shared: bool = False) -> int:
        """Begin a bufferView; ``is_shared`` where several accessors of the example's shape will lie in it."""
        view: dict[str, Any] = {"buffer": 0, "byteOffset": self._file.tell(), "byteLength": 0}
        if target is not None:
            view["target"] = target
        if is_shared:
            view["byteStride"] = example.itemsize * int(np.prod(example.shape[1:]))
        self.views.append(view)
        return len(self.views) - 1

    def add_to(self, view: int, array: np.ndarray, with_bounds: bool = False) -> int:
        """Append an array to the bufferView that was begun last; give its accessor's number."""
        here = self.views[view]
        accessor: dict[str, Any] = {
            "bufferView": view,
            "byteOffset": here["byteLength"],
            "componentType": COMPONENTS[array.dtype.char],
            "count": len(array),
            "type": KINDS[1 if array.ndim == 1 else array.shape[1]],
        }
        if with_bounds:
            low, high = array.min(0), array.max(0)
            accessor["min"], accessor["max"] = (np.atleast_1d(side).tolist() for side in (low, high))
        self.accessors.append(accessor)
        here["byteLength"] += array.nbytes
        self._file.write(np.ascontiguousarray(array).tobytes() + bytes(-array.nbytes % 4))
        return len(self.accessors) - 1

    def add_bytes(self, data: bytes) -> int:
        """Append bytes, such as a picture file, as a bufferView; give its number."""
        self.views.append({"buffer": 0, "byteOffset": self._file.tell(), "byteLength": len(data)})
        self._file.write(data + bytes(-len(data) % 4))
        return len(self.views) - 1

    def write(self, path: Path, tree: dict[str, Any]) -> None:
        """Put the tree, the arrays and their descriptions together into ``path``, and drop the collecting file."""
        length = self._file.tell()
        self._file.close()
        buffers = [{"byteLength": length}]
        text = json.dumps({**tree, "buffers": buffers, "bufferViews": self.views, "accessors": self.accessors})
        words = text.encode()
        words += b" " * (-len(words) % 4)
        with path.open("wb") as whole, self._path.open("rb") as arrays:
            whole.write(struct.pack("<4sIII4s", b"glTF", 2, 28 + len(words) + length, len(words), b"JSON"))
            whole.write(words + struct.pack("<I4s", length, b"BIN\0"))
            shutil.copyfileobj(arrays, whole)
        self._path.unlink()


class Opened:
    """A GLB file read back: its tree, and its accessors as arrays that are read when asked for."""

    def __init__(self, path: Path) -> None:
        with path.open("rb") as file:
            _, _, _, length, _ = struct.unpack("<4sIII4s", file.read(20))
            self.tree: dict[str, Any] = json.loads(file.read(length))
        self._bytes = np.memmap(path, np.uint8, "r", offset=28 + length)

    def array(self, accessor: int) -> np.ndarray:
        """Read an accessor."""
        said = self.tree["accessors"][accessor]
        view = self.tree["bufferViews"][said["bufferView"]]
        dtype = np.dtype({number: char for char, number in COMPONENTS.items()}[said["componentType"]])
        width = {kind: number for number, kind in KINDS.items()}[said["type"]]
        start, count = view["byteOffset"] + said.get("byteOffset", 0), said["count"] * width
        flat = self._bytes[start : start + count * dtype.itemsize].view(dtype)
        return flat.reshape(said["count"], width) if width > 1 else flat
