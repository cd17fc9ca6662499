"""OpenUSD: one mesh per part whose points move, one material, joints as transforms, and a camera that sees the video.

Read by Blender, Houdini, Maya, Unreal, Resolve's Fusion. Positions are exact; times are the clip's own, as time codes
of its frame rate (a variable rate falls between whole codes). USD joins the points of neighbouring samples by straight
lines; where a held drawing or a shot ends, a sample just before repeats what was, so that the change is a step.

The camera is a long lens far away instead of an orthographic one, whose width USD counts in tenths of a unit and
Blender does not: seen from ``CAMERA_DISTANCE`` the layers' gaps shift nothing by more than a few hundredths of a pixel.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32
from PIL import Image

from wildpuppet.errors import StoreError
from wildpuppet.export.animation import Animation
from wildpuppet.export.manifest import Manifest, PositionError, position_error
from wildpuppet.export.naming import identifiers
from wildpuppet.export.options import Options
from wildpuppet.export.pieces import Piece, joint_names, joint_places, pieces_of, places
from wildpuppet.machine import Progress

CAMERA_DISTANCE, FOCAL = 1e5, 50.0
"""Distance in pixels from the rearmost layer, and focal length in tenths of a unit."""
STEP = 1e-3
"""How long before a step the last value is repeated, in frames."""
TEXTURE = "atlas.png"


def write(animation: Animation, folder: Path, options: Options, progress: Progress) -> Manifest:
    """Write FOLDER/puppet.usdc and its texture."""
    stage_path = folder / "puppet.usdc"
    Image.fromarray(animation.puppet.atlas).save(folder / TEXTURE)
    with refusals_told():
        scene = Scene(animation, stage_path, options)
        scene.write(progress)
    return Manifest(
        "top left corner of the picture",
        "x right, y up, z towards the eye: layers by depth",
        scene.first,
        options.units_per_pixel,
        (),
        _read_back(animation, stage_path, scene),
    )


@contextmanager
def refusals_told() -> Iterator[None]:
    """Turn what usd-core cannot write, as on a full disk, into a StoreError of one line."""
    from pxr import Tf

    try:
        yield
    except Tf.ErrorException as error:
        words = " ".join(str(error.args[0].commentary if error.args else error).split())
        raise StoreError(f"--to usd: cannot write ({words}); free some space, or choose another --out") from None


def time_codes(animation: Animation, first: int) -> list[float]:
    """Time code of every frame: whole numbers at an even rate."""
    rate = animation.timing.rate
    return [float(first + animation.timing.seconds(t) * rate) for t in range(len(animation))]


def stepped(animation: Animation) -> list[bool]:
    """Tell for each frame whether it begins at once: after a held drawing, a cut, or a lost character."""
    shot, visible = animation.shot, animation.is_visible
    held = [state == "held" for state in animation.state]
    return [
        t > 0 and bool((held[t - 1] and not held[t]) or shot[t] != shot[t - 1] or visible[t] != visible[t - 1])
        for t in range(len(animation))
    ]


class Scene:
    """A stage that is being filled."""

    def __init__(self, animation: Animation, path: Path, options: Options) -> None:
        from pxr import Usd, UsdGeom

        self.animation, self.path, self.units = animation, path, options.units_per_pixel
        self.first = options.first_of(int(animation.frames[0]))
        self.codes = time_codes(animation, self.first)
        self.pieces = pieces_of(animation.puppet)
        self.stage = Usd.Stage.CreateNew(str(path))
        self.root = UsdGeom.Xform.Define(self.stage, "/Puppet")
        names = identifiers([piece.name for piece in self.pieces], taken=("Material", "Joints"))
        self.paths = [f"/Puppet/{name}" for name in names]

    def write(self, progress: Progress) -> None:
        """Write everything."""
        self._describe()
        material = self._material()
        points = [self._mesh(piece, path, material) for piece, path in zip(self.pieces, self.paths, strict=True)]
        sure = [_confidence_of(self.stage, path) for path in self.paths]
        joints = self._joints()
        visibility = self.root.CreateVisibilityAttr()
        steps, before = stepped(self.animation), ""
        last: list[Float32[np.ndarray, "n 3"]] = []
        for frame, code, is_step in zip(self.animation, self.codes, steps, strict=True):
            now = [_shown(places(piece, frame, self.units), frame.is_visible) for piece in self.pieces]
            for (points_of, extent_of), values, old in zip(points, now, last or now, strict=True):
                if is_step:
                    _set_points(points_of, extent_of, old, code - STEP)
                _set_points(points_of, extent_of, values, code)
            for confidence, piece in zip(sure, self.pieces, strict=True):
                _set_floats(confidence, self.animation.confidence[frame.t, piece.vertices], code)
            seen = "inherited" if frame.is_visible else "invisible"
            if seen != before:
                visibility.Set(seen, code)
            for joint, (x, y) in zip(joints, joint_places(self.animation.puppet, frame.vertices), strict=True):
                joint.Set((float(x * self.units), float(-y * self.units), 0.0), code)
            last, before = now, seen
            progress(frame.t + 1, len(self.animation))
        self._camera()
        self.stage.GetRootLayer().Save()

    def _describe(self) -> None:
        """Write the stage's units, rate and range, and what the clip says of its frames."""
        from pxr import UsdGeom

        stage, animation = self.stage, self.animation
        stage.SetDefaultPrim(self.root.GetPrim())
        UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(stage, 1.0)
        stage.SetTimeCodesPerSecond(float(animation.timing.rate))
        stage.SetFramesPerSecond(float(animation.timing.rate))
        stage.SetStartTimeCode(self.codes[0])
        stage.SetEndTimeCode(self.codes[-1])
        stage.GetRootLayer().customLayerData = {
            "wildpuppet": {
                "name": animation.name,
                "rate": str(animation.timing.rate),
                "pixels_per_unit": 1.0 / self.units,
                "video_width": animation.size[0],
                "video_height": animation.size[1],
            }
        }

    def _material(self) -> Any:
        """Make the one material: the atlas shines by itself and is cut out by its alpha."""
        from pxr import Sdf, UsdShade

        material = UsdShade.Material.Define(self.stage, "/Puppet/Material")
        surface = UsdShade.Shader.Define(self.stage, "/Puppet/Material/Surface")
        texture = UsdShade.Shader.Define(self.stage, "/Puppet/Material/Texture")
        reader = UsdShade.Shader.Define(self.stage, "/Puppet/Material/Coordinates")
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./{TEXTURE}")
        texture.CreateInput("sourceColorSpace", Sdf.ValueTypeNames.Token).Set("sRGB")
        texture.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(
            reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
        )
        for side in ("wrapS", "wrapT"):
            texture.CreateInput(side, Sdf.ValueTypeNames.Token).Set("clamp")
        surface.CreateIdAttr("UsdPreviewSurface")
        surface.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f).Set((0.0, 0.0, 0.0))
        surface.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(1.0)
        surface.CreateInput("emissiveColor", Sdf.ValueTypeNames.Color3f).ConnectToSource(
            texture.CreateOutput("rgb", Sdf.ValueTypeNames.Float3)
        )
        surface.CreateInput("opacity", Sdf.ValueTypeNames.Float).ConnectToSource(
            texture.CreateOutput("a", Sdf.ValueTypeNames.Float)
        )
        material.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", Sdf.ValueTypeNames.Token))
        return material

    def _mesh(self, piece: Piece, path: str, material: Any) -> tuple[Any, Any]:
        """Define a part's mesh; give its attributes that move: points and extent."""
        from pxr import Sdf, UsdGeom, UsdShade, Vt

        mesh = UsdGeom.Mesh.Define(self.stage, path)
        mesh.GetPrim().SetDisplayName(piece.name)
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray(len(piece.faces), 3))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(piece.faces.astype(np.int32).ravel()))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        st = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex)
        st.Set(Vt.Vec2fArray.FromNumpy((piece.uv * (1, -1) + (0, 1)).astype(np.float32)))
        UsdShade.MaterialBindingAPI.Apply(mesh.GetPrim()).Bind(material)
        return mesh.CreatePointsAttr(), mesh.CreateExtentAttr()

    def _joints(self) -> list[Any]:
        """Define a transform per joint; give their translations."""
        from pxr import UsdGeom

        puppet = self.animation.puppet
        if not len(puppet.joint_layers):
            return []
        UsdGeom.Scope.Define(self.stage, "/Puppet/Joints")
        names = identifiers(joint_names(puppet))
        return [UsdGeom.Xform.Define(self.stage, f"/Puppet/Joints/{name}").AddTranslateOp() for name in names]

    def _camera(self) -> None:
        """Put a long lens in front of the picture's middle; its frame is the video's."""
        from pxr import Gf, UsdGeom

        width, height = (side * self.units for side in self.animation.size)
        distance = CAMERA_DISTANCE * self.units
        camera = UsdGeom.Camera.Define(self.stage, "/Puppet/Camera")
        camera.AddTranslateOp().Set((width / 2, -height / 2, distance))
        camera.CreateFocalLengthAttr(FOCAL)
        camera.CreateHorizontalApertureAttr(FOCAL * width / distance)
        camera.CreateVerticalApertureAttr(FOCAL * height / distance)
        camera.CreateClippingRangeAttr(Gf.Vec2f(0.9 * distance, 1.1 * distance))


def _shown(values: Float32[np.ndarray, "n 3"], is_visible: bool) -> Float32[np.ndarray, "n 3"]:
    """Shrink a lost character's meshes to points: Blender takes no notice of visibility that changes."""
    return values if is_visible else np.broadcast_to(values.mean(0), values.shape).copy()


def _set_points(points: Any, extent: Any, values: Float32[np.ndarray, "n 3"], code: float) -> None:
    from pxr import Vt

    points.Set(Vt.Vec3fArray.FromNumpy(values), code)
    extent.Set(Vt.Vec3fArray.FromNumpy(np.stack([values.min(0), values.max(0)])), code)


def _read_back(animation: Animation, path: Path, scene: Scene) -> PositionError:
    """Open the file anew and compare every vertex of every frame with ours."""
    from pxr import Usd, UsdGeom

    stage = Usd.Stage.Open(str(path))
    points = [UsdGeom.Mesh.Get(stage, mesh).GetPointsAttr() for mesh in scene.paths]

    def distances() -> Iterator[Float32[np.ndarray, "n"]]:
        for frame, code in zip(animation, scene.codes, strict=True):
            for piece, attribute in zip(scene.pieces, points, strict=True) if frame.is_visible else ():
                flat = np.array(attribute.Get(code))[:, :2] / (scene.units, -scene.units)
                yield np.linalg.norm(flat - frame.vertices[piece.vertices], axis=1).astype(np.float32)

    return position_error(distances(), "usd-core")


def _confidence_of(stage: Any, path: str) -> Any:
    """Make the primvar that says how sure each vertex is, 0..1."""
    from pxr import Sdf, UsdGeom

    primvars = UsdGeom.PrimvarsAPI(stage.GetPrimAtPath(path))
    return primvars.CreatePrimvar("confidence", Sdf.ValueTypeNames.FloatArray, UsdGeom.Tokens.vertex)


def _set_floats(primvar: Any, values: Float[np.ndarray, "n"], code: float) -> None:
    from pxr import Vt

    primvar.Set(Vt.FloatArray.FromNumpy(np.ascontiguousarray(values, np.float32)), code)
