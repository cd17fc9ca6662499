"""Closed forms of the tables: errors, pairs, means and spreads; the baselines on drawings whose motion is known."""

import cv2
import numpy as np
import pytest
import torch

from wildpuppet.correspond.pck import Truth
from wildpuppet.machine import Machine
from wildpuppet.tables.answer import Answer, load_answer, save_answer
from wildpuppet.tables.autoencoder import SIDE, DeformingAutoEncoder
from wildpuppet.tables.deforming import (
    carried_by_warps,
    load_deforming,
    read_deforming,
    save_deforming,
    train_deforming,
)
from wildpuppet.tables.error import decibels, mean_squared_error, picture_error, picture_errors
from wildpuppet.tables.flow import carried_by_flow, nearest, warped_by_flow
from wildpuppet.tables.pairs import copied, score_pairs
from wildpuppet.tables.sheet import GAP, TILE, WORDS, grid
from wildpuppet.tables.table import MEAN, Score, cell, markdown

SQUARE = 24
HEIGHT, WIDTH = 96, 128


def drawn(left: int, top: int = 34) -> np.ndarray:
    """A square with a darker half on white paper."""
    picture = np.full((HEIGHT, WIDTH, 3), 255, np.uint8)
    cv2.rectangle(picture, (left, top), (left + SQUARE - 1, top + SQUARE - 1), (40, 120, 200), -1)
    cv2.rectangle(picture, (left, top), (left + SQUARE - 1, top + SQUARE // 2), (120, 40, 30), -1)
    return picture


def corners(left: float, top: float = 34.0) -> np.ndarray:
    return np.array([[left + 4, top + 4], [left + 20, top + 4], [left + 12, top + 20]], np.float64)


def truth_of(points: np.ndarray, visible: np.ndarray | None = None) -> Truth:
    seen = np.ones(points.shape[:2], bool) if visible is None else visible
    return Truth(points, seen, np.zeros(points.shape[1], int), 0, np.full(len(points), 100.0))


def test_the_error_is_the_mean_over_pixels_and_colours_and_its_box_leaves_the_paper_out() -> None:
    drawing = np.full((10, 20, 3), 255, np.uint8)
    drawing[2:4, 5:10] = 100
    found = drawing.copy()
    found[2, 5] = (110, 90, 100)  # squares 100, 100, 0 in one of 200 pixels, one of 10 in the box
    error = picture_error(drawing, found)
    assert (error.whole, error.box) == pytest.approx((200 / 600, 200 / 30))
    assert mean_squared_error(drawing, drawing) == 0.0
    assert picture_errors([drawing, drawing], [found, drawing]).whole == pytest.approx(100 / 600)
    assert decibels(776.0) == pytest.approx(19.2, abs=0.05)  # the paper's number, METHOD in dB


def test_all_ordered_pairs_count_where_points_are_visible_in_both() -> None:
    points = np.zeros((4, 5, 2))
    visible = np.ones((4, 5), bool)
    visible[3, 0] = False
    truth = truth_of(points, visible)
    frames = np.array([0, 1, 3])
    carried = copied(points[frames])
    shares, number = score_pairs(truth, frames, carried)
    assert number == 6 * 5 - 4  # point 0 is missing from the four pairs with frame 3
    assert shares == {0.1: 100.0, 0.05: 100.0, 0.025: 100.0}
    carried[0, 1, :, 0] = [0.0, 2.4, 2.6, 6.0, np.nan]
    shares, _ = score_pairs(truth, frames, carried)
    wrong = {alpha: round(26 * (100 - share) / 100) for alpha, share in shares.items()}
    assert wrong == {0.1: 1, 0.05: 2, 0.025: 3}
    assert np.isnan(score_pairs(truth_of(points, ~visible & False), frames, carried)[0][0.1])


def test_a_mean_weighs_sets_alike_and_its_spread_is_over_seeds() -> None:
    rows = [("fox", "a", 0, 1.0), ("fox", "a", 1, 3.0)]
    rows += [("dino", "a", 0, 5.0), ("dino", "a", 1, 11.0), ("fox", "b", 0, 7.0)]
    scores = [Score(name, method, seed, "mse", value) for name, method, seed, value in rows]
    found = cell(scores, "a", "mse", "dino")
    assert found is not None
    assert (found.value, found.spread) == pytest.approx((8.0, np.sqrt(18.0)))
    mean = cell(scores, "a", "mse", MEAN)
    assert mean is not None
    assert (mean.value, mean.spread, mean.num_sets) == (5.0, pytest.approx(np.sqrt(8.0)), 2)  # seeds' means: 3 and 7
    assert cell(scores, "b", "mse", "dino") is None
    lines = markdown(scores, ["mse"]).splitlines()
    assert lines[0] == "| method | fox | dino | mean |"
    assert lines[2] == "| a | 2.0 ± 1.4 | 8.0 ± 4.2 | 5.0 ± 2.8 |"
    assert lines[3] == "| b | 7.0 | - | 7.0 (1 of 2) |"


def test_flow_warps_a_known_drawing_onto_the_wanted_one_and_carries_points_both_ways() -> None:
    pictures = [drawn(40), drawn(46)]
    assert mean_squared_error(pictures[1], warped_by_flow(*pictures)) < 0.2 * mean_squared_error(*pictures)
    assert nearest([drawn(80), drawn(44), drawn(10)], pictures[1]) == 1
    points = np.stack([corners(40), corners(46)])
    points[0, 2] = np.nan
    carried = carried_by_flow(pictures, points)
    assert np.abs(carried[0, 1, :2] - points[1, :2]).max() < 1.0
    assert np.isnan(carried[0, 1, 2]).all()
    assert np.abs(carried[1, 0, :2] - points[0, :2]).max() < 1.0


def test_an_untrained_warp_is_the_identity_and_warps_keep_the_order_of_pixels() -> None:
    network = DeformingAutoEncoder(torch.Generator().manual_seed(0))
    with torch.no_grad():
        seen = network(torch.rand(2, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(1)))
        places = (torch.arange(SIDE) + 0.5) * 2 / SIDE - 1
        assert torch.allclose(seen.warps[0, 0], places.expand(SIDE, SIDE), atol=1e-5)
        assert torch.allclose(seen.warps[1, 1], places[:, None].expand(SIDE, SIDE), atol=1e-5)
        assert torch.allclose(seen.pictures, seen.textures, atol=1e-4)
        network.warp.last.weight.normal_(0.0, 0.3, generator=torch.Generator().manual_seed(2))
        warps = network(torch.rand(1, 3, SIDE, SIDE, generator=torch.Generator().manual_seed(3))).warps
        assert float(warps[:, 0].diff(dim=2).min()) > 0.0
        assert float(warps[:, 1].diff(dim=1).min()) > 0.0


def test_the_auto_encoder_sees_a_new_place_of_a_square_better_than_the_mean_and_carries_points(tmp_path) -> None:  # type: ignore[no-untyped-def]
    known, kept = [drawn(left) for left in range(20, 84, 8)], [drawn(40), drawn(64)]
    network = train_deforming(known, 0, Machine(), steps=120)
    readings = [read_deforming(network, picture) for picture in kept]
    mean = np.mean(known, 0).astype(np.uint8)
    by_mean = picture_errors(kept, [mean, mean]).whole
    assert picture_errors(kept, [reading.picture for reading in readings]).whole < 0.6 * by_mean
    points = np.stack([corners(40), corners(64)])
    carried = carried_by_warps(readings, points)
    still = np.linalg.norm(points[0] - points[1], axis=-1).mean()
    assert np.linalg.norm(carried[0, 1] - points[1], axis=-1).mean() < 0.5 * still
    save_deforming(tmp_path / "network.safetensors", network, "this one")
    assert load_deforming(tmp_path / "network.safetensors", "another") is None
    again = load_deforming(tmp_path / "network.safetensors", "this one")
    assert again is not None
    assert np.array_equal(read_deforming(again, kept[0]).picture, readings[0].picture)


def test_answers_are_kept_exactly_and_only_for_what_they_depend_on(tmp_path) -> None:  # type: ignore[no-untyped-def]
    answer = Answer((drawn(40), drawn(50)), np.array([[[[1.5, np.nan]]]]))
    save_answer(tmp_path / "a", answer, "one")
    found = load_answer(tmp_path / "a", "one")
    assert found is not None
    assert found.pictures is not None
    assert np.array_equal(found.pictures[1], drawn(50))
    assert np.array_equal(found.carried, answer.carried, equal_nan=True)
    assert load_answer(tmp_path / "a", "two") is None
    assert load_answer(tmp_path / "b", "one") is None
    save_answer(tmp_path / "a", Answer(None, answer.carried), "two")
    again = load_answer(tmp_path / "a", "two")
    assert again is not None
    assert again.pictures is None


def test_a_sheet_has_a_column_per_method_and_paper_where_a_picture_is_missing() -> None:
    sheet = grid({"one": [drawn(40), drawn(50)], "two": [drawn(60), None]})
    assert sheet.shape == (WORDS + 2 * (TILE + GAP), 2 * (TILE + GAP), 3)
    assert sheet[WORDS + TILE + GAP :, TILE + GAP :].min() == 255
    assert sheet[WORDS : WORDS + TILE, :TILE].min() < 60
