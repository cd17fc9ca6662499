"""Training the generator against its critic, after the fit and apart from it.

Some drawings are kept for validation: the generator that is kept is the one, averaged over the steps, that lowers their
squared error most, and none at all where none does. Its correction is then scaled by the share that fits those
drawings best. Every step depends on the seed and its number alone, so that a training that was killed goes on from its
checkpoint to exactly the weights that an unbroken one reaches.
"""

import hashlib
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import msgspec
import numpy as np
import torch
from jaxtyping import Float, Float32
from torch import Tensor, nn

from wildpuppet.deform.checkpoint import Progress, load_checkpoint, save_checkpoint
from wildpuppet.deform.learn import device_of, one_thread
from wildpuppet.machine import Machine
from wildpuppet.refine.adversary import as_seen, penalty
from wildpuppet.refine.inputs import BASE, CHANNELS, Method
from wildpuppet.refine.lesson import Batch, Pair, batch_of
from wildpuppet.refine.network import Critic, Generator
from wildpuppet.settings import RefineSettings

Tell = Callable[[int, int, Mapping[str, float]], None]
"""Called after a step as ``tell(done, total, losses)``."""
COLUMNS = ("absolute", "squared", "adversarial", "critic", "slope", "validation")
CHECKPOINT_SECONDS = 20.0
CHECKS = 10
"""Looks at the validation drawings during a training."""
AVERAGED = 0.04
"""Share of the steps that the averaged weights look back over."""
RISING = 40
"""Steps over which the learning rate rises: Adam's first steps are as large as its last."""
FALLING = 1.0 / 3.0
"""Share of the steps over which the learning rate falls."""
VALIDATION = 0.15
LEAST_FOR_VALIDATION = 4


@dataclass(frozen=True, eq=False)
class Learnt:
    """A trained generator (eval mode, CPU), the share of its correction to apply, and the losses of all steps.

    ``losses["validation"]`` is 0 in steps without a look; the others are means over a step's patches.
    """

    generator: Generator
    share: float
    losses: dict[str, Float[np.ndarray, "S"]]


def split(count: int) -> tuple[list[int], list[int]]:
    """Split drawings into those trained on and those for validation, evenly spread; few are all trained on."""
    number = max(1, round(VALIDATION * count)) if count >= LEAST_FOR_VALIDATION else 0
    kept = {int((2 * index + 1) * count / (2 * number)) for index in range(number)}
    return [index for index in range(count) if index not in kept], sorted(kept)


def quiet(done: int, total: int, losses: Mapping[str, float]) -> None:
    """Tell nobody."""


def new_generator(settings: RefineSettings) -> Generator:
    """Build the generator at its start."""
    random = torch.Generator().manual_seed(settings.seed)
    return Generator(CHANNELS[settings.method], settings.width, settings.depth, random)


def learn(
    pairs: Sequence[Pair],
    validation: Sequence[Pair],
    settings: RefineSettings,
    machine: Machine,
    checkpoint: Path | None = None,
    tell: Tell = quiet,
) -> Learnt:
    """Train; a checkpoint that is there is gone on from.

    Raises StoreError where the checkpoint is another training's or cannot be written.
    """
    with one_thread():
        training = _Training(pairs, validation, settings, device_of(machine))
        losses = training.run(machine, checkpoint, tell)
        chosen = training.networks["best"] if validation else training.networks["average"]
        assert isinstance(chosen, Generator)
        chosen = chosen.cpu().eval()
        share = best_share(chosen, validation, settings.method) if validation else 1.0
    return Learnt(chosen, share, {name: losses[:, column].numpy() for column, name in enumerate(COLUMNS)})


class _Training:
    """Generator, critic, the generator's average and the best of it, in one module so that one file keeps them."""

    def __init__(
        self, pairs: Sequence[Pair], validation: Sequence[Pair], settings: RefineSettings, device: torch.device
    ) -> None:
        self.pairs, self.validation, self.settings, self.device = pairs, validation, settings, device
        random = torch.Generator().manual_seed(settings.seed + 1)
        generators = {name: new_generator(settings) for name in ("generator", "average", "best")}
        self.networks = nn.ModuleDict({**generators, "critic": Critic(settings.width, random)}).to(device)
        learning = [*self.networks["generator"].parameters(), *self.networks["critic"].parameters()]
        self.optimizer = torch.optim.Adam(learning, lr=settings.learning_rate, betas=(0.0, 0.9))
        self.base = BASE[settings.method]

    def run(self, machine: Machine, checkpoint: Path | None, tell: Tell) -> Float[Tensor, "S K"]:
        """Take the steps that are left."""
        total, identity = self.settings.iterations, self._identity()
        found = load_checkpoint(checkpoint, self.networks, self.optimizer, identity) if checkpoint else None
        progress = found or Progress(0, torch.zeros(total, len(COLUMNS)))
        saved = time.monotonic()
        machine.progress(progress.step, total)
        for step in range(progress.step, total):
            progress.losses[step] = self._step(step, progress.losses)
            if checkpoint and time.monotonic() - saved >= CHECKPOINT_SECONDS:
                save_checkpoint(
                    checkpoint, self.networks, self.optimizer, Progress(step + 1, progress.losses), identity
                )
                saved = time.monotonic()
            machine.progress(step + 1, total)
            tell(step + 1, total, self._in_words(progress.losses[: step + 1]))
        return progress.losses

    def _in_words(self, losses: Float[Tensor, "s K"]) -> dict[str, float]:
        """Say what is worth telling: the latest of each loss."""
        latest = {name: float(losses[-1, column]) for column, name in enumerate(COLUMNS[:-1])}
        looks = losses[losses[:, -1] > 0.0, -1]
        return latest | ({"validation": float(looks[-1])} if len(looks) else {})

    def _step(self, step: int, losses: Float[Tensor, "S K"]) -> Float[Tensor, "K"]:
        """Teach the critic, then the generator; give the step's losses."""
        row, random = torch.zeros(len(COLUMNS)), np.random.default_rng([self.settings.seed, step])
        for group in self.optimizer.param_groups:
            group["lr"] = self.settings.learning_rate * _rate(step, self.settings.iterations)
        if self.settings.adversarial > 0.0:
            for _ in range(self.settings.critic_steps):
                row[3], row[4] = self._teach_critic(random)
        row[:3] = self._teach_generator(random)
        self._follow(step)
        every = max(1, self.settings.iterations // CHECKS)
        if self.validation and ((step + 1) % every == 0 or step + 1 == self.settings.iterations):
            row[5] = self._validate(losses[:step, 5])
        return row

    def _batch(self, random: np.random.Generator) -> Batch:
        batch = batch_of(self.pairs, self.settings.patch, self.settings.batch, random)
        return Batch(batch.shown.to(self.device), batch.drawn.to(self.device))

    def _made(self, batch: Batch) -> Float[Tensor, "B 4 P P"]:
        made: Tensor = batch.shown[:, self.base : self.base + 4] + self.networks["generator"](batch.shown)
        return as_seen(made)

    def _teach_critic(self, random: np.random.Generator) -> Float[Tensor, "2"]:
        critic, batch = self.networks["critic"], self._batch(random)
        with torch.no_grad():
            made = self._made(batch)
        drawn = as_seen(batch.drawn)
        share = torch.from_numpy(random.random((len(made), 1, 1, 1)).astype(np.float32)).to(self.device)
        wrong = critic(made).mean() - critic(drawn).mean()
        slope = penalty(critic, made, drawn, share)
        self._descend(wrong + self.settings.slope * slope)
        return torch.stack([wrong, slope]).detach().cpu()

    def _teach_generator(self, random: np.random.Generator) -> Float[Tensor, "3"]:
        settings, batch, critic = self.settings, self._batch(random), self.networks["critic"]
        made, drawn = self._made(batch), as_seen(batch.drawn)
        absolute, squared = (made - drawn).abs().mean(), ((made - drawn) ** 2).mean()
        word = torch.zeros((), device=self.device)
        if settings.adversarial > 0.0 and settings.critic_steps > 0:
            critic.requires_grad_(False)
            word = -critic(made).mean()
        self._descend(settings.absolute * absolute + settings.squared * squared + settings.adversarial * word)
        critic.requires_grad_(True)
        return torch.stack([absolute, squared, word]).detach().cpu()

    def _descend(self, loss: Tensor) -> None:
        """Step down; networks that the loss does not reach have no gradient and stay."""
        self.optimizer.zero_grad(set_to_none=True)
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimizer.step()

    def _follow(self, step: int) -> None:
        """Let the average follow, faster in the first steps."""
        span = max(AVERAGED * self.settings.iterations, 1.0)
        keep = min(1.0 - 1.0 / span, (step + 1) / (step + 10))
        pairs = zip(self.networks["average"].parameters(), self.networks["generator"].parameters(), strict=True)
        with torch.no_grad():
            for slow, quick in pairs:
                slow.mul_(keep).add_(quick, alpha=1.0 - keep)

    def _validate(self, before: Float[Tensor, "s"]) -> float:
        """Look at the validation drawings and keep the average if it is the best yet, the untrained one included."""
        average = self.networks["average"]
        assert isinstance(average, Generator)
        error = squared_error(average, self.validation, self.settings.method)
        known = before[before > 0.0]
        start = squared_error(None, self.validation, self.settings.method)
        if error < min(float(known.min()) if len(known) else start, start):
            self.networks["best"].load_state_dict(average.state_dict())
        return error

    def _identity(self) -> str:
        """A digest of the settings and the pictures."""
        digest = hashlib.blake2b(msgspec.json.encode(self.settings), digest_size=16)
        for pair in (*self.pairs, *self.validation):
            digest.update(pair.shown.tobytes())
            digest.update(pair.drawn.tobytes())
        return digest.hexdigest()


def _rate(step: int, total: int) -> float:
    """The learning rate's share: rising to 1, then falling evenly towards 0."""
    return min(1.0, (step + 1) / RISING, (total - step) / max(FALLING * total, 1.0))


def correction_of(generator: Generator, shown: Float32[np.ndarray, "H W C"]) -> Float32[np.ndarray, "H W 4"]:
    """Ask the generator about one picture of any size."""
    height, width = shown.shape[:2]
    step = 2**generator.depth
    padded = np.pad(shown, ((0, -height % step), (0, -width % step), (0, 0)))
    device = generator.first.weight.device
    with torch.no_grad():
        asked = torch.from_numpy(np.ascontiguousarray(padded.transpose(2, 0, 1))[None]).to(device)
        answer = generator(asked)[0].permute(1, 2, 0).cpu().numpy()
    return np.asarray(answer[:height, :width], np.float32)


def corrected(
    base: Float32[np.ndarray, "H W 4"], correction: Float32[np.ndarray, "H W 4"], share: float = 1.0
) -> Float32[np.ndarray, "H W 4"]:
    """Add a correction; colours stay within their alpha, as premultiplied ones must."""
    result = base + np.float32(share) * correction
    alpha = result[..., 3:].clip(0.0, 1.0)
    return np.asarray(np.concatenate([result[..., :3].clip(0.0, alpha), alpha], -1), np.float32)


def squared_error(generator: Generator | None, pairs: Sequence[Pair], method: Method) -> float:
    """Mean squared error over white, 0..255, of the corrected pictures; None: of what they correct."""
    return float(np.mean([_error(generator, pair, method, (1.0,))[0] for pair in pairs]))


SHARES = (0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2)


def best_share(generator: Generator, pairs: Sequence[Pair], method: Method) -> float:
    """Find the share of the correction that lowers the squared error most."""
    errors = np.mean([_error(generator, pair, method, SHARES) for pair in pairs], 0)
    return SHARES[int(errors.argmin())]


def _error(generator: Generator | None, pair: Pair, method: Method, shares: Sequence[float]) -> list[float]:
    shown, drawn = pair.shown.astype(np.float32) / 255.0, pair.drawn.astype(np.float32) / 255.0
    base = shown[..., BASE[method] : BASE[method] + 4]
    correction = np.zeros_like(base) if generator is None else correction_of(generator, shown)
    wanted = drawn[..., :3] - drawn[..., 3:]
    errors = []
    for share in shares:
        result = corrected(base, correction, share)
        errors.append(float(255.0**2 * ((result[..., :3] - result[..., 3:] - wanted) ** 2).mean()))
    return errors
