"""What MDD and PC2 share: the puppet as one OBJ object, and its corners in space frame after frame.

The parts are groups of one object, whose corners keep the order of the cache; u and v as in the atlas, v up. Order of
parts is depth and changes with the frames. A hidden character cannot be hidden: it shrinks to a point.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float32
from PIL import Image

from wildpuppet.export.animation import Animation, Frame
from wildpuppet.export.manifest import PositionError, position_error
from wildpuppet.export.pieces import Piece, pieces_of, places

MATERIAL = "puppet"
MTL = f"""newmtl {MATERIAL}
Kd 1 1 1
illum 0
map_Kd atlas.png
map_d -imfchan m atlas.png
"""


@dataclass(frozen=True, eq=False)
class Corners:
    """The corners of all parts in the order in which OBJ and cache list them."""

    animation: Animation
    pieces: tuple[Piece, ...]
    units: float

    @property
    def count(self) -> int:
        """How many there are."""
        return sum(len(piece.vertices) for piece in self.pieces)

    def at(self, frame: Frame) -> Float32[np.ndarray, "n 3"]:
        """Place them in one frame."""
        placed = np.concatenate([places(piece, frame, self.units) for piece in self.pieces])
        return placed if frame.is_visible else np.broadcast_to(placed[:1], placed.shape)

    def write_obj(self, folder: Path) -> None:
        """Write puppet.obj as it is in the first frame, puppet.mtl and atlas.png."""
        Image.fromarray(self.animation.puppet.atlas).save(folder / "atlas.png")
        (folder / "puppet.mtl").write_text(MTL, encoding="utf-8")
        with (folder / "puppet.obj").open("w", encoding="utf-8") as file:
            file.write(f"mtllib puppet.mtl\no {MATERIAL}\n")
            first = np.concatenate([places(piece, self.animation[0], self.units) for piece in self.pieces])
            file.writelines(f"v {x:.9g} {y:.9g} {z:.9g}\n" for x, y, z in first.tolist())
            for piece in self.pieces:
                file.writelines(f"vt {u:.9g} {1.0 - v:.9g}\n" for u, v in piece.uv.tolist())
            file.writelines(self._faces())

    def _faces(self) -> Iterator[str]:
        before = 1
        for piece in self.pieces:
            name = "_".join(piece.name.split()) or "part"
            yield f"g {name}\nusemtl {MATERIAL}\n"
            for corners in (piece.faces + before).tolist():
                yield "f " + " ".join(f"{corner}/{corner}" for corner in corners) + "\n"
            before += len(piece.vertices)

    def error(self, positions: np.ndarray, read_by: str) -> PositionError:
        """Compare (T, n, 3) positions read back with the animation's vertices, frame by frame."""
        every = np.concatenate([piece.vertices for piece in self.pieces])
        return position_error(
            (
                np.linalg.norm(positions[frame.t, :, :2] / (self.units, -self.units) - frame.vertices[every], axis=1)
                for frame in self.animation
                if frame.is_visible
            ),
            read_by,
        )

    def left_out(self) -> tuple[str, ...]:
        """Say what neither cache holds."""
        lost = [str(number) for number in self.animation.frames[~self.animation.is_visible]]
        hidden = (f"hiding: in frames {', '.join(lost)} the puppet shrinks to a point",) if lost else ()
        return ("joints; held drawings as such: every frame has its own corners", *hidden)


def corners_of(animation: Animation, units: float) -> Corners:
    """Take the puppet's parts."""
    return Corners(animation, pieces_of(animation.puppet), units)
