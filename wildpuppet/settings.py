"""Every knob that changes a result: one frozen struct per stage. Unknown names are refused, ranges are declared.

Constructors do not validate; ``settings_from`` converts once and does.
"""

from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from wildpuppet.errors import SettingsError

Share = Annotated[float, Meta(ge=0.0, le=1.0)]
Positive = Annotated[float, Meta(gt=0.0)]
NotNegative = Annotated[float, Meta(ge=0.0)]
Count = Annotated[int, Meta(ge=1)]


class ProbeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Reading the clip: the frame table and the shots."""

    cut_threshold: Positive = 2.0
    """How many times its neighbours' change a frame's change must be to start a shot; 1.5 to 4. Lower finds more cuts,
    and false ones in fast motion."""
    cut_least_change: Positive = 15.0
    """The least mean change (0..255, HSV) of a cut; 8 to 30. Lower finds cuts between like pictures and false ones."""
    least_shot_frames: Count = 4
    """The shortest shot. Cuts closer together than this are one, and a picture that is back sooner was a flash."""


class TrackSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Following the character's box."""

    method: Literal["csrt", "kcf", "mil", "nano", "vit", "dasiamrpn"] = "csrt"
    """The OpenCV tracker; the last three need ``model``."""
    model: str = ""
    """Model file(s) for nano, vit and dasiamrpn, comma-separated in OpenCV's order."""
    smooth_frames: NotNegative = 2.0
    """Standard deviation of the boxes' smoothing, in frames. Higher is steadier and slower to follow."""
    lost_score: Share = 0.35
    """Appearance score under which the character counts as lost."""


class CropSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Cutting windows around the character, the background plate and the matte."""

    margin: Annotated[float, Meta(ge=0.0, le=3.0)] = 0.25
    """Window size beyond the box, as a share of the box's larger side, on each side."""
    box_pixels: Annotated[int, Meta(ge=32, le=1024)] = 224
    """Crop pixels along the larger side of the character's box. Higher is finer and slower (quadratic)."""
    matte: bool = True
    """Estimate a background plate and a soft matte where the camera's motion allows."""
    hold_threshold: NotNegative = 2.5
    """Largest mean change (0..255) of a small block with which a frame still repeats the drawing before it.

    Higher finds more holds and takes slow changes for one; 0 switches holds off. Typical: 1 to 5.
    """


class PuppetSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Building the mesh from a puppet folder."""

    margin: Annotated[float, Meta(ge=3.0, le=200.0)] = 4.0
    """Canvas pixels that the mesh reaches beyond the drawing, so that the texture's own alpha makes the edge."""
    least_alpha: Annotated[int, Meta(ge=1, le=255)] = 16
    """Alpha (0..255) from which a pixel belongs to its part. Lower takes in faint glows and scanner dust."""
    bridge: Share = 0.1
    """Islands of one part closer than this share of the character's larger side move as one piece."""
    edge: Positive = 0.06
    """Target edge length as a share of the character's larger side. Lower: finer meshes, slower fits."""
    least_angle: Annotated[float, Meta(ge=10.0, le=30.0)] = 25.0
    """Smallest triangle angle in degrees that meshing aims for."""
    subdivide: Annotated[int, Meta(ge=0, le=3)] = 0
    """Rounds of midpoint subdivision; each makes four triangles of one."""
    slender: NotNegative = 3.0
    """A part of some size that is this many times as long as wide may bend in its middle; 0: parts stay rigid."""


class AutoSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The automatic puppet, when no folder is given."""

    most_parts: Annotated[int, Meta(ge=1, le=40)] = 12
    """At most this many parts."""
    least_limb: Share = 0.12
    """Shortest limb, as a share of the character's larger side."""
    seed: int = 0
    """Seed of the random starts of GrabCut's colour clusters and of ties in the medial axis."""


class SearchSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The global search for the pose: tree-structured dynamic programming over rotated part templates."""

    enabled: bool = True
    """Off: the fit starts from the placed rest pose and from the frame before, as the paper does."""
    box_pixels: Annotated[int, Meta(ge=24, le=256)] = 72
    """Search pixels along the larger side of the character. Higher is surer on thin limbs and slower."""
    angles: Annotated[int, Meta(ge=8, le=120)] = 36
    """Rotations of a full turn that are tried."""
    coarse: Share = 0.67
    """Pixels and angles of a first search of unordered drawings, as a share of the fine one's; 0 leaves it out."""
    num_best: Annotated[int, Meta(ge=1, le=64)] = 8
    """Hypotheses kept per frame, beside those in which twin limbs trade places."""
    sweeps: Annotated[int, Meta(ge=0, le=10)] = 2
    """How often every limb of the best pose is taken off and hung anew, while that helps."""
    colours: Annotated[int, Meta(ge=2, le=64)] = 20
    """Palette size of the part templates. Higher tells similar shades apart and costs time."""
    hinge_slack: Positive = 0.03
    """How far a hinge opens at the cost ``hinge``, as a share of the character's size; beyond, the cost is linear."""
    hinge: NotNegative = 0.025
    """Cost of a hinge that opens by its slack, in units of an average part's evidence. Higher holds limbs tighter."""
    hinge_reach: Share = 0.2
    """Farthest opening of a hinge, as a share of the character's size."""
    hinge_drawings: Annotated[int, Meta(ge=0, le=1000)] = 12
    """Drawings from which the hinges' places are learnt before the search; 0 takes them as the puppet has them."""
    turn: NotNegative = 0.05
    """Cost of turning a part against its parent, per squared radian (linear beyond half a radian)."""
    bend: NotNegative = 0.15
    """The same for a part that bends (``puppet.slender``): its lower piece against its upper one."""
    stretch: NotNegative = 0.01
    """Cost of a part that is a fifth longer or shorter than drawn, in units of an average part's evidence; it grows
    with the square. Higher holds the puppet's proportions; 0: all parts keep their lengths."""
    cover: NotNegative = 0.4
    """Price, beside a wrong colour's, of a drawing's pixel that no part explains; in clips (guessed mattes) none."""
    reorder: NotNegative = 0.2
    """Cost of drawing the layers in another order than the puppet's, in units of an average part's evidence."""
    time_weight: NotNegative = 1.0
    """Cost of parts moving between drawings, per part and character size. 0 takes each frame by itself."""


class FitSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The energy and its descent. Units: images 0..255, vertices in [-1, 1], areas in pixels (METHOD.md section 2)."""

    method: Literal["descent", "network"] = "descent"
    """descent: search, then exact-gradient descent on vertices; network: the paper's deformation network."""
    steps: Annotated[int, Meta(ge=0, le=100000)] = 100
    """Descent steps; each pyramid level takes its share of them."""
    levels: tuple[tuple[float, float, float], ...] = ((0.3, 0.4, 0.0), (0.6, 0.2, 0.3), (1.0, 0.0, 0.4))
    """Pyramid, coarse to fine: (crop scale, share of steps on whole parts, share on parts and mesh)."""
    overrule: Share = 0.85
    """Of a drawing another hypothesis of the search's is taken when the fit from there costs less than this share of
    the fit from the best one; 0: never. In clips the choice over time decides."""
    robust: Positive = 60.0
    """Grey levels beyond which a wrong pixel counts no more than a very wrong one."""
    matte: NotNegative = 0.5
    """Price of a wrongly covered or uncovered pixel, as a share of a very wrong colour's."""
    hold_scale: NotNegative = 0.5
    """How stiffly a part keeps its size while parts move as wholes."""
    reconstruction: NotNegative = 1.0
    """Weight of the masked reconstruction."""
    arap: NotNegative = 2500.0
    """Weight of as-rigid-as-possible. Higher: stiffer parts; lower: softer, noisier."""
    joints: NotNegative = 1.0e4
    """Weight of the hinges."""
    joint_slack: Positive = 0.01
    """Gap of a hinge, in [-1, 1] units, beyond which it costs linearly. Higher forces hinges closed."""
    area: NotNegative = 2.0e-3
    """Weight of the area term."""
    seed: int = 0
    """Seed of every random choice."""


class DistilSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Fit, distil, refit: a network learns from the clip's fits; every frame is fitted again from what it reads."""

    iterations: Annotated[int, Meta(ge=0)] = 0
    """Training steps; 0 leaves the first fit as it is. 1000 take a minute or two, in clips alone."""
    seed: int = 0
    """Seed of initial weights and batches."""


class TrainSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Training the deformation network (fit.method = "network")."""

    iterations: Annotated[int, Meta(ge=1)] = 2000
    """Optimiser steps."""
    batch: Count = 16
    """Frames per step."""
    learning_rate: Positive = 1.0e-4
    """Adam's step size; the global bias learns at a tenth of it."""
    code: Count = 512
    """Size of the latent code."""
    code_relu: bool = False
    """The paper's ReLU on the code; off makes the code two-sided, which interpolation wants."""
    encoder_pixels: Annotated[int, Meta(ge=16, le=512)] = 64
    """Side of the square image the encoder sees."""
    distil: Share = 0.25
    """Share of the iterations that first teach the network the search's poses; 0 is the paper."""
    as_printed: bool = False
    """The paper's ARAP (vertex cells) and mask area; off: triangles and layer areas at the frame's own scale."""
    seed: int = 0
    """Seed of initial weights and batches."""


class RefineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The appearance refinement: from the rendered puppet to the drawn frame."""

    method: Literal["both", "network", "texture"] = "both"
    """network: the paper's generator, from the rendered puppet alone; texture: no network, the colours that the
    drawings nearest in pose show; both: a generator that corrects those."""
    neighbours: Annotated[int, Meta(ge=1, le=64)] = 8
    """Drawings per part whose colours are averaged."""
    beside: Annotated[float, Meta(ge=0.0, le=0.5)] = 0.07
    """How far beyond the puppet the drawings are looked up, as a share of its larger side. Higher finds more of what
    the puppet lacks, and more that belongs elsewhere."""
    iterations: Annotated[int, Meta(ge=1)] = 600
    """Generator steps."""
    batch: Count = 4
    """Patches per step."""
    patch: Annotated[int, Meta(ge=32, le=1024)] = 96
    """Side of a patch, crop pixels; a multiple of 2 to the power of ``depth``."""
    width: Annotated[int, Meta(ge=4, le=256)] = 12
    """Channels of the first layer; pix2pix has 64, for a GPU. Higher learns more and is slower (quadratic)."""
    depth: Annotated[int, Meta(ge=1, le=7)] = 4
    """Halvings of the picture; pix2pix has 8 for 256 pixels."""
    learning_rate: Positive = 1.0e-3
    """Adam's step size at first; it falls to 0 over the last third. The paper's kind of network takes 1e-4 for long."""
    critic_steps: Annotated[int, Meta(ge=0, le=20)] = 5
    """Critic steps per generator step; 0 trains without a critic, several times faster."""
    absolute: NotNegative = 100.0
    """Weight of the mean absolute difference (gamma 1)."""
    squared: NotNegative = 1000.0
    """Weight of the mean squared difference; 0 is the paper. Higher: nearer on average, softer lines."""
    slope: NotNegative = 10.0
    """Weight of the critic's gradient penalty (gamma 2)."""
    adversarial: NotNegative = 1.0
    """Weight of the critic's word. Higher: crisper, farther from the drawing."""
    seed: int = 0
    """Seed of initial weights and patches."""


class OutSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is written to OUT beside meshes.npz and run.json."""

    preview: bool = True
    """Write preview.mp4 and sheet.png."""
    meshes: Literal["none", "obj", "glb"] = "none"
    """Also write one mesh file per frame."""


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All stages' settings; a TOML preset has one table per field."""

    probe: ProbeSettings = ProbeSettings()
    track: TrackSettings = TrackSettings()
    crop: CropSettings = CropSettings()
    puppet: PuppetSettings = PuppetSettings()
    auto: AutoSettings = AutoSettings()
    search: SearchSettings = SearchSettings()
    fit: FitSettings = FitSettings()
    distil: DistilSettings = DistilSettings()
    train: TrainSettings = TrainSettings()
    out: OutSettings = OutSettings()


def settings_from(tree: dict[str, Any]) -> Settings:
    """Convert and validate nested plain values; raises SettingsError that names the setting and what was expected."""
    try:
        return msgspec.convert(tree, Settings)
    except msgspec.ValidationError as error:
        raise SettingsError(f"{_mistake(str(error), tree)}; `wildpuppet run --help` lists every setting") from None


def _mistake(message: str, tree: dict[str, Any]) -> str:
    """Put msgspec's sentence into ours: which setting, what was expected, what was found."""
    expected, _, place = message.replace("`", "").partition(" - at $.")
    table, _, name = place.partition(".")
    if not isinstance(tree.get(table), dict) or name not in tree[table]:
        return f"settings: {message}"
    expected = expected[:1].lower() + expected[1:].partition(", got")[0]
    return f"setting {place}: {expected}, found {tree[table][name]!r}"
