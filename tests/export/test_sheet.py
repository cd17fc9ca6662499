from dataclasses import replace

import numpy as np

from tests.correspond import scene
from wildpuppet.export.meshes import vertices_video
from wildpuppet.export.palette import colour_of
from wildpuppet.export.sheet import MOST_CELLS, TILE, character_window, sheet, spread


def world(num_frames):
    character = scene.puppet()
    still = np.tile(np.eye(2, 3), (num_frames, 2, 1, 1))
    crops, fit = scene.posed(character, still)
    box = np.array([40.0, 30.0, 100.0, 50.0])  # the ink of both parts
    boxes = [np.r_[(box[:2] - m[:, 2]) * 1.5, box[2:] * 1.5] for m in crops.video_from_crop]
    return character, replace(crops, box_crop=np.stack(boxes)), fit


def test_frames_are_spread_with_both_ends():
    assert spread(5, 18) == [0, 1, 2, 3, 4]
    chosen = spread(190, 18)
    assert (chosen[0], chosen[-1], len(chosen)) == (0, 189, 18)
    assert np.ptp(np.diff(chosen)) <= 1


def test_the_window_holds_box_and_mesh_but_not_one_that_ran_away():
    _, crops, fit = world(1)
    placed = vertices_video(crops, fit)
    left, _, side = character_window(crops, placed, fit, 0)
    assert left <= 36
    assert left + side >= 144
    assert side < 1.3 * 108
    assert character_window(crops, placed + 10000.0, fit, 0)[2] < 300


def test_every_cell_shows_source_wireframe_and_puppet():
    character, crops, fit = world(40)
    asked = []

    def source(number):
        asked.append(number)
        picture = np.full((scene.CANVAS[1], scene.CANVAS[0], 3), 120, np.uint8)
        picture[40:60, 90:140] = (10, 200, 10)
        return picture

    picture = sheet(source, character, crops, fit)
    assert asked == [100 + index for index in spread(40, MOST_CELLS)]
    assert picture.shape[1] > 9 * TILE
    assert picture.shape[0] > 6 * TILE
    drawn = (np.abs(picture.astype(int) - [40, 90, 200]).max(-1) <= 3).sum()
    _, _, side = character_window(crops, vertices_video(crops, fit), fit, 0)
    expected = 50 * 20 * (TILE / side) ** 2 * MOST_CELLS
    assert abs(drawn / expected - 1) < 0.1  # the arm's colour, drawn again in every cell
    shown = (np.abs(picture.astype(int) - [10, 200, 10]).max(-1) <= 3).sum()
    assert shown > expected * 0.95  # and the source's arm at least once in every cell
    assert (picture[:24] == colour_of(1)).all(-1).any()


def test_one_lost_frame_and_no_losses_still_make_a_sheet():
    character, crops, fit = world(1)
    fit = replace(fit, state=("lost",), losses={}, vertices_crop=np.full_like(fit.vertices_crop, np.nan))
    picture = sheet(lambda number: np.zeros((120, 160, 3), np.uint8), character, crops, fit)
    assert picture.shape[1] > 3 * TILE
