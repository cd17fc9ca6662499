"""Background and colour put together: the log-odds, pixel by pixel, that the character is there."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, UInt8

from wildpuppet.track.colours import Colours, counted, ring_counts
from wildpuppet.track.scene import Foreground, Region, Scene, inside_box
from wildpuppet.track.trackers import Box

# The character has moved away from where it was when this share of its box is sure foreground.
MOVED_AWAY = 0.15
# Log-odds of colour above which foreground may be the character, and above which the rest of its box is its body.
AWAY_COLOUR, HERE_COLOUR = -0.4, 0.7
# Weight of a pixel of the reference box that may be background.
UNSURE = 0.4
# A strip beyond a side, this share of the larger side wide, is crowded when so much of it has changed.
STRIP, CROWDED = 0.25, 0.25
# Unless the log-odds of the changed colours are, in the mean, at least this.
CROWD_COLOUR = 0.6
# They are surely the character's own from here: a box may then grow without bound, so what is alike is not enough.
OWN_COLOUR = 1.5
# A box is filled by the character when this share more of it is foreground than of what is around it.
FILLED = 0.2


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log-odds for the character inside a region; ``known`` where the background is. 0 where nothing is known.

    ``colour`` is the part of the log-odds that colour alone says.
    ``moved_away``, 0 to 1: how much of the character is surely seen elsewhere than where its box was given.
    """

    region: Region
    odds: Float[np.ndarray, "a b"]
    known: Bool[np.ndarray, "a b"]
    colour: Float[np.ndarray, "a b"]
    moved_away: float

    def mask(self, box: Box) -> Bool[np.ndarray, "a b"]:
        """Mark where the character may be: where nothing is known, inside the predicted box."""
        unsure = inside_box(self.region, box, 0.0) & (self.odds > self.moved_away - 1.0)
        marked: np.ndarray = np.where(self.known, self.odds > 0.0, unsure)
        return marked

    def presence(self, box: Box) -> tuple[float, float]:
        """Return how much a box stands out as foreground from what is around it, 0 to 1, and how far that is known."""
        inside, around = inside_box(self.region, box, 0.0), inside_box(self.region, box, 0.25)
        around &= ~inside
        inside_known, around_known = inside & self.known, around & self.known
        if inside_known.sum() < 10:
            return 0.0, 0.0
        filled = float((self.odds[inside_known] > 0).mean())
        beside = float((self.odds[around_known] > 0).mean()) if around_known.sum() >= 10 else 0.0
        share = float(inside_known.sum()) / max(float(inside.sum()), 1.0)
        return float(np.clip((filled - beside) / FILLED, 0.0, 1.0)), share

    def crowded(self, box: Box) -> Bool[np.ndarray, "4"]:
        """Say beyond which sides (left, top, right, bottom) much of the known background has changed its look.

        Not to the character's colours: then the box is too small.
        """
        x, y, w, h = box
        by = STRIP * max(w, h)
        strips = ((x - by, y, by, h), (x, y - by, w, by), (x + w, y, by, h), (x, y + h, w, by))
        return np.array([self.is_crowd(self.known_in(strip)) for strip in strips])

    def own_strips(self, box: Box, change: Float[np.ndarray, "4"]) -> Bool[np.ndarray, "4"]:
        """Say where what each side (left, top, right, bottom) would take in, moving by ``change``, is the character's.

        By its colours: what differs from the background there has them.
        """
        x, y, w, h = box
        left, top, right, bottom = (float(step) for step in change)
        strips = ((x + left, y, -left, h), (x, y + top, w, -top), (x + w, y, right, h), (x, y + h, w, bottom))
        return np.array([self.is_own(self.known_in(strip)) for strip in strips])

    def is_own(self, strip: Bool[np.ndarray, "a b"]) -> bool:
        """Say whether what has changed in a strip surely has the character's colours."""
        changed = strip & (self.odds > 0)
        return bool(changed.any() and self.colour[changed].mean() >= OWN_COLOUR)

    def is_crowd(self, strip: Bool[np.ndarray, "a b"]) -> bool:
        """Say whether much of a strip has changed, and not to the character's colours."""
        changed = strip & (self.odds > 0)
        return bool(changed.sum() > CROWDED * strip.sum() and self.colour[changed].mean() < CROWD_COLOUR)

    def known_in(self, box: Box) -> Bool[np.ndarray, "a b"]:
        """Mark known background inside a box."""
        return np.asarray(inside_box(self.region, box, 0.0) & self.known)


def gather(
    picture: UInt8[np.ndarray, "h w 3"], index: int, scene: Scene, colours: Colours, region: Region, box: Box
) -> Evidence:
    """Compare a region of a picture with the background and the character's colours; ``box`` is where it may be."""
    seen = scene.foreground(picture, index, region, box)
    colour = colours.log_odds(picture[region.rows, region.columns])
    moved_away = share_moved_away(seen, colour, region, box)
    doubtful = np.where(seen.was_inside, moved_away * (seen.odds_inside + colour), 0.0)
    return Evidence(region, np.where(seen.known, seen.odds + colour, doubtful), seen.known, colour, moved_away)


def share_moved_away(seen: Foreground, colour: Float[np.ndarray, "a b"], region: Region, predicted: Box) -> float:
    """Say how surely the character is elsewhere than where its box was given, 0 to 1.

    It is, when enough foreground of its colours is seen before known background, and little of its colours is left
    where its box was given. Then what stayed as it was there is background rather than the character.
    """
    away = float((seen.known & (seen.odds + colour > 0) & (colour > AWAY_COLOUR)).sum())
    here = float((seen.was_inside & inside_box(region, predicted, 0.0) & (colour > HERE_COLOUR)).sum())
    enough = min(1.0, away / (MOVED_AWAY * max(predicted[2] * predicted[3], 1.0)))
    return enough * away / max(away + here, 1.0)


def learn_colours(picture: UInt8[np.ndarray, "h w 3"], index: int, scene: Scene, region: Region, box: Box) -> Colours:
    """Learn the character's colours from a known box and the background behind it.

    What differs from the background counts fully, what may be either counts a little, what is background not at all.
    """
    seen = scene.foreground(picture, index, region, box)
    inside = inside_box(region, box, 0.0)
    changed = np.where(seen.known, seen.odds > 0.0, np.where(seen.was_inside & (seen.odds_inside < 0.0), UNSURE, 1.0))
    part = picture[region.rows, region.columns]
    background = seen.known & (seen.odds < 0.0)
    around = ring_counts(picture, box) + counted(part, inside & background)
    return Colours(counted(part, inside * changed), around)
