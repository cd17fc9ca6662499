"""What a method says about one set of drawings, kept in a folder of its own so that it is never asked twice.

pictures/00.png ...   its picture of every test drawing, if it makes pictures
carried.npz           its points of every test drawing in every other, if it carries points
answer.json           what the answer depends on; written last
"""

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from wildpuppet import atomic
from wildpuppet.disk import read_arrays, write_arrays
from wildpuppet.store import read_json

Picture = UInt8[np.ndarray, "H W 3"]

SCHEMA = "wildpuppet.answer/1"
CARRIED_SCHEMA = "wildpuppet.carried/1"
ANSWER, CARRIED, PICTURES = "answer.json", "carried.npz", "pictures"


@dataclass(frozen=True, eq=False)
class Answer:
    """One picture per test drawing, and ``carried[a, b, n]``: point n of test drawing a in test drawing b."""

    pictures: tuple[Picture, ...] | None = None
    carried: Float[np.ndarray, "A A N 2"] | None = None


def save_answer(folder: Path, answer: Answer, identity: str) -> None:
    """Write an answer; ``answer.json`` comes last, so that a killed command leaves none that is not whole."""
    with atomic.disk_errors(folder):
        (folder / PICTURES).mkdir(parents=True, exist_ok=True)
        (folder / ANSWER).unlink(missing_ok=True)
        for number, picture in enumerate(answer.pictures or ()):
            Image.fromarray(picture).save(folder / PICTURES / f"{number:02d}.png")
        if answer.carried is not None:
            write_arrays(folder / CARRIED, CARRIED_SCHEMA, {"carried": answer.carried.astype(np.float32)})
    has = {"pictures": answer.pictures is not None, "carried": answer.carried is not None}
    tree = {"schema": SCHEMA, "identity": identity, "num_pictures": len(answer.pictures or ()), "has": has}
    atomic.write_text(folder / ANSWER, json.dumps(tree, indent=1) + "\n")


def load_answer(folder: Path, identity: str) -> Answer | None:
    """Read an answer back; None where there is none, or it depends on something else."""
    if not (folder / ANSWER).is_file():
        return None
    tree = read_json(folder / ANSWER)
    if (tree.get("schema"), tree.get("identity")) != (SCHEMA, identity):
        return None
    pictures, carried = None, None
    if tree["has"]["pictures"]:
        files = [folder / PICTURES / f"{number:02d}.png" for number in range(tree["num_pictures"])]
        pictures = tuple(np.asarray(Image.open(file).convert("RGB")) for file in files)
    if tree["has"]["carried"]:
        carried = read_arrays(folder / CARRIED, CARRIED_SCHEMA)["carried"].astype(np.float64)
    return Answer(pictures, carried)
