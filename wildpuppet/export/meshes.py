"""meshes.npz: the puppet in every frame, for programs that read numpy; the texture lies beside it as atlas.png.

| array | shape | what |
|---|---|---|
| ``vertices_video`` | (T, V, 2) f32 | video pixels, corner origin, y down |
| ``vertices_canvas`` | (V, 2) f32 | the rest pose, canvas pixels |
| ``triangles`` | (F, 3) i32 | vertices of each triangle |
| ``layer_of_vertex`` | (V,) i32 | index into ``names`` |
| ``names`` | (L,) str | the parts |
| ``order`` | (T, L) i32 | layers back to front |
| ``uv``, ``atlas_size`` | (V, 2) f32, (2,) i32 | 0..1 of the atlas, v down; its (W, H) |
| ``joint_layers``, ``joint_vertices``, ``joint_weights`` | (J, 2), (J, 2, 3), (J, 2, 3) | hinges, as in the puppet |
| ``frames`` | (T,) i64 | frame numbers of the clip |
| ``pts``, ``time_base`` | (T,) i64, (2,) i64 | exact times: pts * time_base[0] / time_base[1] seconds; clips only |
| ``state`` | (T,) str | fitted, held, doubtful or lost |
| ``confidence`` | (T, V) f32 | 0..1 |
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float
from PIL import Image

from wildpuppet.disk import write_arrays
from wildpuppet.export.whole import whole_file
from wildpuppet.geometry.affine import apply
from wildpuppet.types import Clip, Crops, Fit, Puppet

SCHEMA = "wildpuppet.meshes/1"


def write_meshes(path: Path, puppet: Puppet, crops: Crops, fit: Fit, clip: Clip | None = None) -> None:
    """Write ``path`` (meshes.npz) and atlas.png beside it; written twice they are the same to the byte.

    ``clip`` gives the frames' times; drawings have none. Raises StoreError where the disk refuses.
    """
    arrays: dict[str, np.ndarray] = {
        "vertices_video": vertices_video(crops, fit).astype(np.float32),
        "vertices_canvas": puppet.vertices.astype(np.float32),
        "triangles": puppet.triangles.astype(np.int32),
        "layer_of_vertex": puppet.layer_of_vertex.astype(np.int32),
        "names": np.array(puppet.names, np.str_),
        "order": fit.order.astype(np.int32),
        "uv": unit_uv(puppet).astype(np.float32),
        "atlas_size": np.array(puppet.atlas.shape[1::-1], np.int32),
        "joint_layers": puppet.joint_layers.astype(np.int32),
        "joint_vertices": puppet.joint_vertices.astype(np.int32),
        "joint_weights": puppet.joint_weights.astype(np.float32),
        "frames": fit.frames.astype(np.int64),
        "state": np.array(fit.state, np.str_),
        "confidence": fit.confidence.astype(np.float32),
    }
    if clip is not None:
        base = clip.time_base
        arrays["pts"] = clip.pts[fit.frames].astype(np.int64)
        arrays["time_base"] = np.array([base.numerator, base.denominator], np.int64)
    with whole_file(path) as beside:
        write_arrays(beside, SCHEMA, arrays)
    write_atlas(path.with_name("atlas.png"), puppet)


def write_atlas(path: Path, puppet: Puppet) -> None:
    """Write the texture atlas as it is: RGBA, straight alpha."""
    with whole_file(path) as beside:
        Image.fromarray(puppet.atlas).save(beside, format="PNG")


def vertices_video(crops: Crops, fit: Fit) -> Float[np.ndarray, "T V 2"]:
    """Place the fit's vertices in the video."""
    return apply(crops.video_from_crop, fit.vertices_crop.astype(np.float64))


def unit_uv(puppet: Puppet) -> Float[np.ndarray, "V 2"]:
    """Texture coordinates 0..1, v down, of each vertex."""
    return np.asarray(puppet.uv / np.array(puppet.atlas.shape[1::-1], np.float64))
