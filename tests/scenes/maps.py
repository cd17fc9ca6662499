"""Affine maps, destination first, for drawing; the library has its own, and the two must not share a mistake."""

import numpy as np


def about(centre: tuple[float, float], scale: float, radians: float) -> np.ndarray:
    """Turn (x towards y) and scale around a point."""
    linear = scale * np.array([[np.cos(radians), -np.sin(radians)], [np.sin(radians), np.cos(radians)]])
    return np.column_stack([linear, np.array(centre) - linear @ np.array(centre)])


def after(a_from_b: np.ndarray, b_from_c: np.ndarray) -> np.ndarray:
    linear = a_from_b[..., :2] @ b_from_c[..., :2]
    shift = a_from_b[..., :2] @ b_from_c[..., 2:] + a_from_b[..., 2:]
    return np.concatenate([linear, shift], -1)


def inverse(a_from_b: np.ndarray) -> np.ndarray:
    linear = np.linalg.inv(a_from_b[:, :2])
    return np.column_stack([linear, -linear @ a_from_b[:, 2]])


def mapped(a_from_b: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ np.swapaxes(a_from_b[..., :2], -1, -2) + a_from_b[..., None, :, 2]


def opencv(a_from_b: np.ndarray) -> np.ndarray:
    """Corner origin to OpenCV's pixel centres."""
    half = np.array([[0.5], [0.5]])
    return np.concatenate([a_from_b[:, :2], a_from_b[:, 2:] + a_from_b[:, :2] @ half - half], -1)
