"""Ways of a redundant arm along a whole curve: which of the configurations of each place to take, so that the curve can
be followed to its end, within the limits and free.

At each of some places, layers of configurations are found: in closed form, with the joints that are held for it at
values all over their limits (`self_motions`), or else by inverse kinematics from those of the place before and from
random ones. The cheapest way through the layers, by the squares of the joints' steps, as shares of what the joints can
do in a second, and by how close they come to their limits, is sought by dynamic programming, as in Morgan, Millard
& Sukhatme, "CppFlow: Generative inverse kinematics for efficient and robust Cartesian path planning" (2024). Whether a
configuration is free is checked only once a way leads through it; those near one that is not are left out with it,
until nothing else leads further. Then the way is evened: the joints' steps are made as small as the poses let them be,
where all stays free.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from hdplan.planner.job.following import POSE_ERROR, NotFollowedError, Places, spread
from hdplan.planner.job.layers_loop import TURN, steps_between
from hdplan.planner.job.places import poses_of
from hdplan.planner.job.self_motions import close_branches
from hdplan.planner.kinematics.closed_form import ClosedForm, closed_form
from hdplan.planner.kinematics.inverse import Aim, damped_step
from hdplan.planner.robot.robot import Robot
from hdplan.scenes.array_types import Array, Mask
from hdplan.scenes.lazy_imports import scipy
from hdplan.scenes.path_constraints import Follow
from hdplan.scenes.poses import Pose
from hdplan.scenes.targets import PoseTarget

LEAST_LAYERS, MOST_LAYERS = 16, 300  # layers
SPACING = 0.02  # [m] between layers, turns counted as lengths
VALUES = (1, 96, 144, 216)  # of joints that are held for a closed form, by their number
FIRST_CONFIGURATIONS = 300  # sought at the first place
NEW_CONFIGURATIONS = 120  # sought again at every other place
KEPT_CONFIGURATIONS = 240  # kept at most at a place
SOLVER_STEPS = 40  # of damped least squares, at most
LARGEST_STEP = 0.45  # [rad] or [m] that a joint may move from layer to layer
# [rad] or [m] between ways and the limits of joints, and the largest share of a joint's range for it
INNER_MARGIN, INNER_SHARE = 0.03, 0.01
NEAR_BLOCKED = 0.12  # [rad] or [m] around a configuration that is not free, where others of its layer are left out too
LIMIT_POWER, LIMIT_WEIGHT = 5, 0.05  # power of the square, and weight, of how close joints are to their limits
SAME_BEGINNING = 0.3  # [rad] or [m] between the beginnings of two ways that are tried one after the other
EVENING_ROUNDS, BACK_STEPS = 10, 8  # of evening, and steps back to the poses after each
EVENED_STEP = 1e-2  # [rad] or [m] below which a round of it ends
EVENING_DAMPING = 1e-3  # of evening
REFINEMENTS, EVENINGS = 2, 2  # times that configurations are put in between at last, and evened each time
MOST_WAYS = 300  # greatest number of ways

Free = Callable[[Array], Mask]
"""True (B,) where configurations (B, n) are free."""


def ways_along(
    robot: Robot,
    start: Array | None,
    follow: Follow,
    length: float,
    quick: Array,
    seed: int,
    free: Free,
    finer: int = 1,
    close: bool = False,
) -> Iterator[Array]:
    """Yield ways (layers, n) along a curve, the best first: from `start` (n,), or from wherever it can be begun, in
    which case each begins elsewhere. `quick` (n,) are the joints' greatest speeds; `finer` is how many times as many
    layers there are, and values of joints that are held for a closed form; `close`, whether there are more of these
    where configurations would be far apart. Raises NotFollowedError, with how far a way leads and how dense the search
    was, where there is none."""
    count = int(np.clip(np.ceil(length / SPACING * finer), LEAST_LAYERS, MOST_LAYERS))
    poses, (low, high) = spread(follow, 2 * count - 1), inner_limits(robot)
    found = _configurations(robot, start, follow, poses_of(poses[::2]), np.random.default_rng(seed), finer, close)
    speeds = quick / quick.max()
    layers = Layers(robot, found, speeds)
    places = Places.of(robot, follow, poses, speeds, low, high)
    farthest, yielded = 0.0, False
    for _ in range(MOST_WAYS):
        way = layers.cheapest()
        if way is None:
            farthest = max(farthest, layers.leads_to)
            if not layers.take_back(free):
                break
            continue
        if not layers.look_at(way, places, free):
            continue
        evened = _evened(places, layers.joined(way), start is not None, free)
        yield _refined(places, follow, evened, start is not None, free)
        if start is not None:
            return
        yielded = True
        layers.begin_elsewhere(way)
    if not yielded:
        most = max(len(rows) for rows in found)
        raise NotFollowedError(
            f"no free way was found along it beyond {farthest:.0%}, through {count} places with up to {most} "
            "configurations each"
        )


@dataclass(eq=False)
class Layers:
    """Configurations of places along a curve, and the cheapest way through them."""

    robot: Robot
    configurations: list[Array]  # (k, n) of each place
    quick: Array  # (n,) joints' speeds, as shares of the greatest
    _own: list[Array] = field(init=False)  # (k,) costs of each; infinite where one is not free
    _steps: list[Array] = field(init=False)  # (k, l) costs of what leads from layer to layer
    _unknown: list[Mask] = field(init=False)  # (k,) not checked for contact yet
    _guessed: list[Mask] = field(init=False)  # (k,) which are left out as they are near one that is not
    _parted: list[tuple[int, Mask, Array]] = field(default_factory=list)  # steps left out so, and what they cost
    _guesses: bool = True
    _reached: list[tuple[Array, Array]] = field(init=False)  # costs of the best ways there, and from where they come
    _changed: int = 0  # the first layer of which costs are no longer true

    def __post_init__(self) -> None:
        """Weigh the configurations and the steps between them."""
        robot = self.robot
        self._circles = robot.turning & ~robot.followed & ~(robot.upper - robot.lower < TURN)
        bounded = np.isfinite(robot.upper - robot.lower)
        low, high = robot.lower[bounded], robot.upper[bounded]
        middle, half = 0.5 * (low + high), 0.5 * (high - low)
        shares = [np.abs(rows[:, bounded] - middle) / half for rows in self.configurations]
        self._weights = [LIMIT_WEIGHT * ((share * share) ** LIMIT_POWER).sum(axis=1) for share in shares]
        self._own = [each.copy() for each in self._weights]
        self._steps = [self._between(*pair) for pair in itertools.pairwise(self.configurations)]
        self._unknown = [np.ones(len(rows), dtype=bool) for rows in self.configurations]
        self._guessed = [~each for each in self._unknown]
        self._reached = []

    def _between(self, last: Array, rows: Array) -> Array:
        """The costs (l, k) of steps to some configurations from others."""
        return steps_between(last, rows, self.quick, self._circles, LARGEST_STEP)

    def cheapest(self) -> list[int] | None:
        """Return the configuration of each layer on the cheapest way; None if there is no way."""
        del self._reached[self._changed :]
        while (k := len(self._reached)) < len(self._own):
            if k == 0:
                self._reached.append((self._own[0], np.zeros(0, np.int64)))
                continue
            total = self._steps[k - 1] + self._reached[-1][0]
            best = total.argmin(axis=1)
            self._reached.append((total[np.arange(len(total)), best] + self._own[k], best))
        self._changed = len(self._own)
        cost = self._reached[-1][0]
        way = [int(cost.argmin())]
        if not np.isfinite(cost[way[0]]):
            return None
        for _, best in reversed(self._reached[1:]):
            way.append(int(best[way[-1]]))
        return way[::-1]

    @property
    def leads_to(self) -> float:
        """The share of the curve to which there is a way, as far as is known."""
        reached = [bool(np.isfinite(cost).any()) for cost, _ in self._reached]
        return max(0, [*reached, False].index(False) - 1) / (len(reached) - 1)

    def look_at(self, way: list[int], places: Places, free: Free) -> bool:
        """Return whether a way is free, and between two layers, too; if not, what is not is left out from now on, and,
        as a guess, what is near."""
        new = [k for k, chosen in enumerate(way) if self._unknown[k][chosen]]
        found = free(np.array([self.configurations[k][way[k]] for k in new])) if new else np.ones(0, dtype=bool)
        for k, is_free in zip(new, found.tolist(), strict=True):
            self._unknown[k][way[k]] = False
            if not is_free:
                near = self._near(k, way[k], NEAR_BLOCKED) & self._unknown[k] & self._guesses
                self._guessed[k] |= near
                near[way[k]] = True
                self._leave_out(k, near)
        if not found.all():
            return False
        wrong = np.flatnonzero(_wrong_between(places, self.joined(way), free)).tolist()
        for k in wrong:
            ends = (self._near(i, way[i], NEAR_BLOCKED if self._guesses else 0.0) for i in (k + 1, k))
            parted = np.logical_and.outer(*ends)
            if self._guesses:
                others = parted.copy()
                others[way[k + 1], way[k]] = False
                self._parted.append((k, others, self._steps[k][others]))
            self._steps[k][parted] = np.inf
            self._changed = min(self._changed, k + 1)
        return not wrong

    def take_back(self, free: Free) -> bool:
        """Return True if anything was left out as a guess; check it for contact, and guess no more."""
        unchecked = [(k, i) for k, guessed in enumerate(self._guessed) for i in np.flatnonzero(guessed).tolist()]
        if not self._guesses or not (unchecked or self._parted):
            return False
        self._guesses, self._changed = False, 0
        for k, parted, cost in reversed(self._parted):
            self._steps[k][parted] = cost
        if not unchecked:
            return True
        found = free(np.array([self.configurations[k][i] for k, i in unchecked]))
        for (k, i), is_free in zip(unchecked, found.tolist(), strict=True):
            self._unknown[k][i] = False
            if is_free:
                self._own[k][i] = self._weights[k][i]
        return True

    def begin_elsewhere(self, way: list[int]) -> None:
        """Leave out what is near the beginning of a way."""
        near = self._near(0, way[0], SAME_BEGINNING)
        self._guessed[0] &= ~near
        self._leave_out(0, near)

    def _near(self, layer: int, chosen: int, around: float) -> Mask:
        at = self.configurations[layer]
        return np.asarray(np.abs(at - at[chosen]).max(axis=1) <= around)

    def _leave_out(self, layer: int, which: Mask) -> None:
        self._own[layer][which] = np.inf
        self._changed = min(self._changed, layer)

    def joined(self, way: list[int]) -> Array:
        """Return a way (layers, n), on which joints that turn without an end do so the short way."""
        found = np.array([at[chosen] for at, chosen in zip(self.configurations, way, strict=True)])
        steps = np.diff(found, axis=0)
        turns = np.where(self._circles, TURN * np.round(steps / TURN), 0.0)
        found[1:] -= np.cumsum(turns, axis=0)
        return found


def _configurations(
    robot: Robot,
    start: Array | None,
    follow: Follow,
    poses: Sequence[Pose],
    rng: np.random.Generator,
    finer: int,
    close: bool,
) -> list[Array]:
    """Return configurations of places along a curve. Raises NotFollowedError where one has none."""
    low, high = np.maximum(robot.lower, -np.pi), np.minimum(robot.upper, np.pi)
    seed = np.clip(0.5 * (low + high) if start is None else start, robot.lower, robot.upper)
    inner = inner_limits(robot)
    found: list[Array] = []
    for pose in poses:
        target = PoseTarget(follow.link, pose, free_rotation=follow.free_rotation)
        if not found and start is not None:
            found.append(start[None])
            continue
        if (form := closed_form(robot, target)) is not None:
            branches = close_branches if close else ClosedForm.branches
            reached = branches(form, robot, target, seed, finer * VALUES[len(form.ways[0].held)])
        else:
            fresh = rng.uniform(low, high, (NEW_CONFIGURATIONS if found else FIRST_CONFIGURATIONS, robot.n))
            reached = _reached(robot, target, np.concatenate([found[-1], fresh]) if found else fresh)
        reached = reached[((reached >= inner[0]) & (reached <= inner[1])).all(axis=1)]
        if not len(reached):
            raise NotFollowedError(f"no joint values were found for {len(found) / (len(poses) - 1):.0%} of the way")
        found.append(
            reached[rng.permutation(len(reached))[: finer * KEPT_CONFIGURATIONS]]
            if len(reached) > finer * KEPT_CONFIGURATIONS
            else reached
        )
    return found


def inner_limits(robot: Robot) -> tuple[Array, Array]:
    """Return the limits of joints (n,), (n,) for ways."""
    room = np.minimum(INNER_MARGIN, INNER_SHARE * (robot.upper - robot.lower))
    return robot.lower + room, robot.upper - room


def _reached(robot: Robot, target: PoseTarget, q: Array) -> Array:
    """Return the configurations, of (B, n), that can be moved onto a target, on it."""
    aim = Aim.at(robot, target)
    for _ in range(SOLVER_STEPS):
        error, jacobian = aim.linearized(q)
        if (np.abs(error) <= POSE_ERROR).all():
            break
        q = damped_step(robot, q, error, jacobian)
    error, _ = aim.linearized(q)
    return np.asarray(q[(aim.sizes(error) <= POSE_ERROR).all(axis=(1, 2))])


def _wrong_between(places: Places, way: Array, free: Free) -> Mask:
    """True (layers − 1,) where between two configurations of a way (layers, n) the middle of the two poses is out of
    reach, or not free."""
    middles = places.every(slice(1, None, 2))
    rows = middles.back(0.5 * (way[:-1] + way[1:]), BACK_STEPS)
    return ~middles.reached(rows) | ~free(rows)


def _evened(between: Places, way: Array, fixed: bool, free: Free) -> Array:
    """Return a way (layers, n) on which joints make smaller steps, free where it was checked. Configurations that
    would not be free any more stay where they are; mostly all are free, and one check at the end is enough."""
    boldly = _with_smaller_steps(between, way, fixed, lambda rows: np.ones(len(rows), dtype=bool))
    if free(boldly).all() and not _wrong_between(between, boldly, free).any():
        return boldly
    return _with_smaller_steps(
        between, way, fixed, lambda rows: free(rows) & ~_beside(_wrong_between(between, rows, free))
    )


def _with_smaller_steps(between: Places, way: Array, fixed: bool, kept: Callable[[Array], Mask]) -> Array:
    """Return a way whose configurations all are `kept`, or as they were."""
    places = between.every(slice(0, None, 2))
    held = np.zeros(len(way), dtype=bool)
    held[0] = fixed
    for _ in range(EVENING_ROUNDS):
        step = _shortening(places, way, held)
        moved = way + min(1.0, LARGEST_STEP / max(np.abs(step).max(), 1e-12)) * step
        moved[~held] = places.back(moved, BACK_STEPS)[~held]
        wrong = (
            ~places.reached(moved) | ~kept(moved) | _beside(np.abs(np.diff(moved, axis=0)).max(axis=1) > LARGEST_STEP)
        )
        if (wrong & ~held).any():
            held |= wrong
            continue
        done, way = np.abs(moved - way).max() <= EVENED_STEP, moved
        if done:
            break
    return way


def _beside(steps: Mask) -> Mask:
    """True (layers,) at both ends of some of the steps (layers − 1,)."""
    return np.asarray(np.append(steps, False) | np.append(False, steps))


def _shortening(places: Places, way: Array, held: Mask) -> Array:
    """Return steps (layers, n) by which a way's own steps become least in the sum of their squares, to first order: of
    each configuration only what moves no pose, but nothing of those that are held."""
    _, jacobian = places.linearized(way)
    (count, n), rank = way.shape, 6 if places.free == "none" else 5
    loose = np.linalg.svd(jacobian * places.quick)[2][:, rank:].transpose(0, 2, 1) * ~held[:, None, None]
    steps, parts = np.diff(way, axis=0) / places.quick, n - rank
    pull = np.zeros((count, parts))
    pull[:-1] += np.einsum("kni,kn->ki", loose[:-1], steps)
    pull[1:] -= np.einsum("kni,kn->ki", loose[1:], steps)
    own = np.einsum("kni,knj->kij", loose, loose)
    own[1:-1] *= 2.0
    own += EVENING_DAMPING * np.eye(parts)
    both = -np.einsum("kni,knj->kij", loose[:-1], loose[1:])  # of each with the next
    band = np.zeros((2 * parts, count, parts))  # SciPy's upper form
    for i, j in itertools.product(range(parts), range(parts)):
        if i <= j:
            band[2 * parts - 1 + i - j, :, j] = own[:, i, j]
        band[parts - 1 + i - j, 1:, j] = both[:, i, j]
    found = scipy.linalg.solveh_banded(band.reshape(2 * parts, -1), pull.ravel()).reshape(count, parts)
    return np.asarray(np.einsum("kni,ki->kn", loose, found) * places.quick)


def _refined(between: Places, follow: Follow, way: Array, fixed: bool, free: Free) -> Array:
    """Return a way with configurations between its own, evened too, where they are free then."""
    for _ in range(REFINEMENTS):
        places = replace(between, poses=spread(follow, 2 * len(way) - 1))
        finer, held = np.repeat(way, 2, axis=0)[:-1], np.zeros(2 * len(way) - 1, dtype=bool)
        finer[1::2] = 0.5 * (way[:-1] + way[1:])
        held[0] = fixed
        finer[~held] = places.back(finer)[~held]
        evened = finer
        for _ in range(EVENINGS):
            evened = evened + _shortening(places, evened, held)
            evened[~held] = places.back(evened)[~held]
        found = [each for each in (evened, finer) if places.reached(each).all() and free(each).all()]
        if not found:
            return way
        way = found[0]
    return way
