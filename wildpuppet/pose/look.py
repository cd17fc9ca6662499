"""One frame at one size of the puppet, ready to be searched: what parts cost where, and what whole poses cost."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int, UInt8

from wildpuppet.geometry import affine
from wildpuppet.pose import evidence as ev
from wildpuppet.pose import kernels
from wildpuppet.pose.dynamic import Solution, Springs, State, pull_table, solve
from wildpuppet.pose.exchange import PRICE, exchange_colours, told_apart
from wildpuppet.pose.moves import Candidate, spring_cost
from wildpuppet.pose.pieces import Pieces
from wildpuppet.pose.place import pose_vertices
from wildpuppet.pose.pull import Pull
from wildpuppet.pose.rehang import NOWHERE, Picture, hung_anew, seated_anew
from wildpuppet.pose.templates import (
    PartImage,
    Templates,
    make_templates,
    mean_colours,
    palette_of,
    part_images,
)
from wildpuppet.pose.tree import Tree, part_areas, tree_of
from wildpuppet.pose.twins import Pair, twin_limbs
from wildpuppet.puppet.bends import extent_of
from wildpuppet.render.render import Mesh, mesh_of
from wildpuppet.render.texture import Texture, texture_at
from wildpuppet.settings import SearchSettings
from wildpuppet.types import Puppet

SIZE_STEP = 1.06
"""Ratio between neighbouring sizes that are tried."""
FINE = 6
"""Sizes of the templates between two steps."""
KEPT_SIZES = 2 * FINE
"""Sizes whose templates are kept."""
KEPT_LENGTHS = 4 * KEPT_SIZES
"""Lengths, over all sizes, of which each part's templates are kept."""
TIGHT = 1 / 3
"""Slack of a bend, as a share of a hinge's: where it is, is known."""


@dataclass(eq=False)
class Searcher:
    """What the search prepares once per puppet; templates are kept per size. ``shaded`` twins differ in colour.

    The layers of all that it holds are the puppet's rigid ``pieces``; ``along`` is each one's own axis.
    """

    pieces: Pieces
    settings: SearchSettings
    search_from_crop: float
    images: tuple[PartImage, ...] = field(init=False)
    tree: Tree = field(init=False)
    mesh: Mesh = field(init=False)
    colours: Float[np.ndarray, "L 3"] = field(init=False)
    twins: list[Pair] = field(init=False)
    shaded: list[Pair] = field(init=False)
    along: Float[np.ndarray, "L 2"] = field(init=False)
    palette: Float[np.ndarray, "C 3"] | None = None
    of_size: dict[float, tuple[Templates, Texture]] = field(default_factory=dict)
    of_length: dict[tuple[float, int, int], Templates] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.images = part_images(self.puppet)
        self.tree = tree_of(self.puppet, self.pieces.whole.layer_of_piece)
        self.mesh = mesh_of(self.puppet)
        self.colours = mean_colours(self.images)
        self.twins = twin_limbs(self.tree, part_areas(self.puppet), self.colours)
        self.shaded = told_apart(self.twins, self.colours)
        self.along = np.stack([extent_of(self.puppet, layer).along for layer in range(self.puppet.num_layers)])

    @property
    def puppet(self) -> Puppet:
        """The puppet with a layer per piece."""
        return self.pieces.puppet

    def exact_step(self, crop_scale: float) -> float:
        """Give a size (crop pixels per canvas pixel) in steps of ``SIZE_STEP``."""
        return math.log(crop_scale * self.search_from_crop) / math.log(SIZE_STEP)

    def size_step(self, crop_scale: float) -> float:
        """Round a size (crop pixels per canvas pixel) to one that templates have, in steps."""
        return fine_step(self.exact_step(crop_scale))

    def at_size(self, step: float) -> tuple[Templates, Texture]:
        """Fetch or make the templates and the texture of a size."""
        if step not in self.of_size:
            scale = SIZE_STEP**step
            if self.palette is None:
                self.palette = palette_of(self.images, scale, self.settings.colours)
            templates = make_templates(self.images, scale, self.settings.angles, self.palette)
            if len(self.of_size) == KEPT_SIZES:
                self.of_size.pop(next(iter(self.of_size)))
            self.of_size[step] = (templates, ev.lab_texture(texture_at(self.puppet, scale)))
        self.of_size[step] = self.of_size.pop(step)  # the last one that was asked for goes last
        return self.of_size[step]

    def stretched_part(self, scale: float, layer: int, step: int, shape: Float[np.ndarray, "2 2"]) -> Templates:
        """Fetch or make the templates of one part ``step`` steps longer, its picture changed by ``shape``."""
        key = (scale, layer, step)
        if key not in self.of_length:
            assert self.palette is not None
            if len(self.of_length) == KEPT_LENGTHS * len(self.images):
                self.of_length.pop(next(iter(self.of_length)))
            part = (self.images[layer],)
            self.of_length[key] = make_templates(part, scale, self.settings.angles, self.palette, shape=shape)
        return self.of_length[key]


@dataclass(frozen=True, eq=False)
class Look:
    """A frame as ``moves.Frame`` wants it; build with ``look_at``. Places are search pixels."""

    searcher: Searcher
    solution: Solution
    picture: Picture
    pull: Pull | None
    shapes: Mapping[int, Float[np.ndarray, "2 2"]] = field(default_factory=dict)
    """What is done to layers about their pivots before they are turned (``stretch``)."""

    @property
    def templates(self) -> Templates:
        """The parts' templates at this size."""
        return self.solution.templates

    @property
    def twins(self) -> list[Pair]:
        """Limbs that can be taken for one another."""
        return self.searcher.twins

    @property
    def shaded(self) -> list[Pair]:
        """Those of them that differ in colour."""
        return self.searcher.shaded

    def maps(self, states: tuple[State, ...]) -> Float[np.ndarray, "L 2 3"]:
        """Turn states into search_from_canvas maps."""
        templates, table = self.templates, np.array(states)
        maps = affine.similarity(
            np.full(len(states), templates.scale), templates.radians[table[:, 0]], np.zeros((len(states), 2))
        )
        for layer, shape in self.shapes.items():
            maps[layer, :, :2] @= shape
        pivots = np.stack([image.pivot for image in self.searcher.images])
        maps[:, :, 2] = table[:, 1:] + 0.5 - affine.apply(maps, pivots[:, None])[:, 0]
        return maps

    def nearest(self, crop_from_canvas: Float[np.ndarray, "P 2 3"], order: Int[np.ndarray, "L"]) -> Candidate:
        """Round a pose of the pieces, with its order of the whole puppet's layers, to the search grid."""
        height, width = self.picture.evidence.matte.shape
        turns = affine.turn_of(crop_from_canvas) / (2 * np.pi)
        angles = np.rint(turns * len(self.templates.radians)).astype(int) % len(self.templates.radians)
        pivots = np.stack([image.pivot for image in self.searcher.images])
        places = affine.apply(crop_from_canvas, pivots[:, None])[:, 0] * self.searcher.search_from_crop - 0.5
        places = np.rint(places).astype(int).clip(0, (width - 1, height - 1))
        states = tuple((int(a), int(p[0]), int(p[1])) for a, p in zip(angles, places, strict=True))
        return Candidate(states, tuple(int(piece) for piece in self.searcher.pieces.parted(order)))

    def unexplained(
        self, vertices: Float[np.ndarray, "B V 2"], order: Int[np.ndarray, "B L"], worn: Texture | None = None
    ) -> Float[np.ndarray, "B"]:
        """Sum what poses leave unexplained or explain wrongly, pixels; ``worn`` instead of the puppet's texture."""
        return ev.unexplained_cost(
            self.picture.evidence, vertices, order, self.searcher.mesh, worn or self.picture.texture
        )

    def judge(self, candidates: list[Candidate], worn: Texture | None = None) -> Float[np.ndarray, "B"]:
        """Give the costs of whole poses, lower is better."""
        searcher, states = self.searcher, np.array([c.states for c in candidates])
        vertices = pose_vertices(searcher.puppet, np.stack([self.maps(c.states) for c in candidates]))
        order = np.array([c.order for c in candidates])
        pixels = self.unexplained(vertices, order, worn)
        costs: Float[np.ndarray, "B"] = self.picture.unit * pixels + spring_cost(self.solution, states)
        if self.pull is not None:
            costs = costs + self.pull.on_states(states, searcher.images, self.templates, searcher.search_from_crop)
        return costs + searcher.settings.reorder * (np.diff(order, axis=1) < 0).any(1)

    def rehang(
        self,
        candidate: Candidate,
        head: int,
        free: Sequence[int],
        num: int,
        reach: Mapping[int, int] = NOWHERE,
        turns: Mapping[int, int] = NOWHERE,
    ) -> list[Candidate]:
        """Hang the limb at ``head`` anew, as ``hung_anew`` does."""
        vertices = pose_vertices(self.searcher.puppet, self.maps(candidate.states)[None])[0]
        found = hung_anew(
            self.picture, self.solution, candidate.states, candidate.order, vertices, head, free, num, reach, turns
        )
        return [Candidate(states, candidate.order) for states in found]

    def reseat(self, candidate: Candidate) -> Candidate:
        """Seat the root anew, as ``seated_anew`` does."""
        vertices = pose_vertices(self.searcher.puppet, self.maps(candidate.states)[None])[0]
        return Candidate(
            seated_anew(self.picture, self.solution, candidate.states, candidate.order, vertices), candidate.order
        )

    def exchanged(self, candidate: Candidate, pairs: list[Pair]) -> float:
        """Give the cost of a pose in which pairs of twins wear each other's colours, its price included."""
        worn = exchange_colours(self.picture.texture, self.searcher.puppet, pairs, self.searcher.colours)
        return float(self.judge([candidate], worn)[0]) + PRICE * len(pairs)


def fine_step(step: float) -> float:
    """Round to a size that templates have."""
    return round(step * FINE) / FINE


def look_at(searcher: Searcher, image: UInt8[np.ndarray, "H W 4"], step: float, pull: Pull | None = None) -> Look:
    """Prepare one crop at a size: each part's cost everywhere, and the tree's."""
    evidence = ev.evidence_of(image, searcher.search_from_crop, searcher.settings.cover)
    templates, texture = searcher.at_size(step)
    assert searcher.palette is not None
    part_weight = np.sqrt(templates.area / templates.area.mean())
    wrong = ev.colours_wrong(evidence, searcher.palette)
    maps = ev.disagreement_maps(evidence, wrong, templates.reach)
    unary = [
        kernels.template_costs(
            maps, templates.pixels, templates.weights * (part_weight[layer] / templates.area[layer]),
            templates.start[layer], templates.count[layer], templates.reach, *evidence.matte.shape,
        )
        for layer in range(len(searcher.images))
    ]  # fmt: skip
    pulled: tuple[Float[np.ndarray, "K H W"], ...] = ()
    if pull is not None:
        pulled = tuple(np.zeros_like(costs) for costs in unary)
        pull.add_to(list(pulled), searcher.images, templates, searcher.search_from_crop)
        unary = [costs + more for costs, more in zip(unary, pulled, strict=True)]
    solution = solve(unary, searcher.tree, searcher.images, templates, _springs(searcher.settings))
    unit = float(part_weight.sum() / templates.area.sum())
    return Look(searcher, solution, Picture(evidence, wrong, searcher.mesh, texture, unit, pulled), pull)


def _springs(settings: SearchSettings) -> Springs:
    slack = settings.hinge_slack * settings.box_pixels
    reach = max(3, round(settings.hinge_reach * settings.box_pixels))
    hinge, loose, tight = (pull_table(share * slack, settings.hinge, reach) for share in (1.0, 2.0, TIGHT))
    return Springs(hinge, loose, tight, settings.turn, settings.bend)
