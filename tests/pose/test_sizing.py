import pytest

from tests.pose.boxes import crops_around
from tests.scene_values import crops_of
from tests.scenes import stress_clip
from wildpuppet.machine import Machine
from wildpuppet.pose.place import place, size_of
from wildpuppet.pose.sizing import placed_at_size
from wildpuppet.puppet.build import build
from wildpuppet.settings import PuppetSettings, SearchSettings

QUICK = SearchSettings(box_pixels=48, angles=24)


def test_size_is_told_by_the_picture_where_the_box_misleads():
    """Arms that lie at the body make the box narrow: its area is that of a puppet a quarter smaller."""
    scene = stress_clip("narrow", frames=1, size=(160, 120)).scene
    puppet, crops = build(scene.cutout, PuppetSettings(edge=0.1)), crops_of(scene)
    true = size_of(scene.video_from_canvas[0, 0])
    assert size_of(place(puppet, crops)) < 0.78 * true
    assert size_of(placed_at_size(puppet, crops, QUICK, Machine(workers=1))) == pytest.approx(true, rel=0.12)
    unsearched = SearchSettings(enabled=False)
    assert size_of(placed_at_size(puppet, crops, unsearched, Machine())) == size_of(place(puppet, crops))


def test_a_box_of_the_puppets_own_shape_tells_the_size():
    scene = stress_clip("narrow", frames=1, size=(160, 120)).scene
    puppet = build(scene.cutout, PuppetSettings(edge=0.1))
    crops = crops_around(1, (400, 400), box=(40, 50, 123, 198))  # nothing to see: it is not looked at
    expected = place(puppet, crops)
    assert (placed_at_size(puppet, crops, QUICK, Machine()) == expected).all()
