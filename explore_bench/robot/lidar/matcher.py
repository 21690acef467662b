"""Correlative scan matching: where the robot must stand for its scan to lie on the surfaces that others have seen.

E. B. Olson, "Real-time correlative scan matching", ICRA 2009, with the surface rules of Karto (docs/stage.md): the
surfaces that a few key poses have seen are smeared into a field of values from 0 to 1; the response of a pose is the
field's mean over the scan's points; it is sampled on a lattice around the prediction, and climbed from the best sample.
What odometry says is a prior of the search, so that in a corridor, which leaves a direction open, nothing slides.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import TAU, Array, Grid, Pose, wrap_angle

Field = NDArray[np.float32]
Cells = NDArray[np.int64]
Owners = NDArray[np.int16]

FIELD_RESOLUTION = 0.025
"""Edge of a cell of the field [m]: half of SMEAR; as large as it, cells draw the top of a response to them."""

STRIDE = 2
"""Cells of the field between two samples of a search."""

SMEAR = 0.05
"""σ of the Gaussian around every surface point [m]."""

ON_SURFACE = 0.5
"""A point lies on a surface where the field has at least this value: within 6 cm of it."""

SAME = 0.98
"""Where the field has this value a surface was written already, within a centimetre: most points of a window."""

POINT_SPACING = 0.08
"""Surface points between two neighbouring hits are at most this far apart [m]: hits 10 m away are 17 cm apart, and a
scan would lock onto them like onto beads."""

NORMAL_REACH = 0.1
"""A normal is that of the line between two points of the surface this far on either side [m]: near the robot hits lie
closer together than they are wrong, and a filter by such normals would keep hits that err to one side."""

LONGEST_GAP = 0.5
"""Two hits farther apart are not of one surface [m]."""

WEIGHT = 500.0
"""What a response of 1 weighs in the logarithm of the likelihood: as many points of a scan as tell of their own."""

SHARPNESS = 200.0
"""Samples of the response weigh exp(SHARPNESS · difference to the best) in its covariance."""

FLOOR = 0.002, 0.0005
"""Least standard deviations of a match [m, rad], as measured in dense scenes: the lattice resolves no finer ones."""

OPEN = 0.5
"""A direction whose standard deviation exceeds this share of a uniform response's is open: nothing there limits it."""

OPEN_SIGMA = 1.0
"""Standard deviation that an open direction is given [m]."""

_LEVELS = 32
_HALF = math.ceil(2.0 * SMEAR / FIELD_RESOLUTION)
_ON = math.ceil(SMEAR * math.sqrt(-2.0 * math.log(ON_SURFACE)) / FIELD_RESOLUTION - 0.5)  # cells on a point's surface
_OFFSETS = np.arange(-_HALF, _HALF + 1) + 0.5 - (np.arange(_LEVELS)[:, None] + 0.5) / _LEVELS
_KERNEL = np.exp(-0.5 * (_OFFSETS * FIELD_RESOLUTION / SMEAR) ** 2).astype(np.float32)
"""Gaussian along one axis at the cells around a point, by the point's place in its cell: to 0.8 mm, and no exponential
for each of the hundreds of thousands of values that a match writes."""

FINEST = 0.002, 0.0006
"""Steps at which climbing ends [m, rad]."""


class Surfaces(NamedTuple):
    """What one scan tells, in the robot's frame.

    Attributes
    ----------
    hits : where the beams ended [m], shape (H, 2).
    points : points on the surfaces between them [m], shape (S, 2).
    normals : unit normal of each, towards the lidar, shape (S, 2); 0 where a hit has no neighbour.
    """

    hits: Array
    points: Array
    normals: Array


class Window(NamedTuple):
    """Half widths of a search [m, rad] and the step between its angles [rad]; positions are a field's cell apart."""

    reach: float
    turn: float
    turn_step: float


SEQUENTIAL = Window(0.15, math.radians(6.0), math.radians(1.0))
"""Search of a scan against those before it."""

LOOP = Window(0.6, math.radians(12.0), math.radians(1.0))
"""Search of a scan against those of an earlier visit."""


class Match(NamedTuple):
    """Where a scan fits best.

    Attributes
    ----------
    pose : of the robot.
    response : mean of the field over the scan's points, 0 to 1.
    covariance : of the match alone, without the prior, in the world's axes, shape (3, 3).
    frame : whose surfaces it is measured against: first quartile of the frames that first saw what its points lie on.
    """

    pose: Pose
    response: float
    covariance: Array
    frame: int


@jit
def surfaces_of(ranges: Array, reach: float) -> Surfaces:
    """Surfaces that a scan shows; ranges as in `RangeScan`, what lies beyond `reach` [m] is left out."""
    beams = ranges.shape[0]
    spread = TAU / beams
    xy = np.empty((beams, 2))
    hits = np.empty((beams, 2))
    joined = np.empty(beams, dtype=np.bool_)  # with the following one
    count = 0
    for beam in range(beams):
        xy[beam, 0], xy[beam, 1] = ranges[beam] * math.cos(spread * beam), ranges[beam] * math.sin(spread * beam)
        joined[beam] = _joined(ranges[beam], ranges[(beam + 1) % beams], spread, reach)
        if ranges[beam] <= reach:
            hits[count] = xy[beam]
            count += 1
    room = 2 * beams + int(beams * LONGEST_GAP / POINT_SPACING)
    points, normals = np.empty((room, 2)), np.empty((room, 2))
    total = 0
    for beam in range(beams):
        if not ranges[beam] <= reach:
            continue
        following = (beam + 1) % beams
        last = following if joined[beam] else beam
        before, after = _reach_out(xy, joined, beam, -1), _reach_out(xy, joined, last, 1)
        normal_x, normal_y = _normal(
            xy[beam, 0], xy[beam, 1], xy[after, 0] - xy[before, 0], xy[after, 1] - xy[before, 1]
        )
        dx, dy = xy[last, 0] - xy[beam, 0], xy[last, 1] - xy[beam, 1]
        pieces = max(int(math.ceil(math.hypot(dx, dy) / POINT_SPACING)), 1)
        for k in range(pieces):
            points[total, 0], points[total, 1] = xy[beam, 0] + dx * k / pieces, xy[beam, 1] + dy * k / pieces
            normals[total, 0], normals[total, 1] = normal_x, normal_y
            total += 1
    return Surfaces(hits[:count].copy(), points[:total].copy(), normals[:total].copy())


@jit
def _reach_out(xy: Array, joined: NDArray[np.bool_], beam: int, way: int) -> int:
    """Beam at least NORMAL_REACH from another along its surface, or the surface's last; way is 1 or −1."""
    beams, at = xy.shape[0], beam
    for _ in range(beams):
        following = (at + way) % beams
        if not joined[at if way > 0 else following]:
            break
        at = following
        if math.hypot(xy[at, 0] - xy[beam, 0], xy[at, 1] - xy[beam, 1]) >= NORMAL_REACH:
            break
    return at


@jit
def _joined(one: float, other: float, spread: float, reach: float) -> bool:
    """Whether two neighbouring ranges are of one surface: near to each other for how far away they are."""
    if not (one <= reach and other <= reach):
        return False
    across = min(one, other) * spread
    gap = math.hypot(one - other, across)
    return gap <= LONGEST_GAP and abs(one - other) <= 3.0 * across + SMEAR


@jit
def _normal(x: float, y: float, dx: float, dy: float) -> tuple[float, float]:
    """Unit normal of a surface along (dx, dy) at (x, y), on the side of the origin."""
    length = math.hypot(dx, dy)
    if length == 0.0:
        return 0.0, 0.0
    normal_x, normal_y = -dy / length, dx / length
    if normal_x * x + normal_y * y > 0.0:
        return -normal_x, -normal_y
    return normal_x, normal_y


@jit
def smear(
    points: Array,
    normals: Array,
    starts: Cells,
    poses: Array,
    viewpoint: Pose,
    field: Field,
    owners: Owners,
    grid: Grid,
) -> None:
    """Write the surfaces of key frames into a field, which is cleared before, and who first saw them; of its shape.

    Cells count along the rows, and are unsigned: numba asks of every other index whether it counts from the end.

    Parameters
    ----------
    points, normals : of all frames one after another, in each frame's own axes, shapes (S, 2).
    starts : where those of each frame begin and the last's end, shape (F + 1,).
    poses : estimates of the frames, shape (F, 3).
    viewpoint : about where the scan was taken: of walls seen from their other side it sees nothing.
    """
    field[:] = 0.0
    values, whose = field.reshape(-1), owners.reshape(-1)
    for frame in range(poses.shape[0]):
        c, s = math.cos(poses[frame, 2]), math.sin(poses[frame, 2])
        dx, dy = viewpoint[0] - poses[frame, 0], viewpoint[1] - poses[frame, 1]
        from_x, from_y = c * dx + s * dy, c * dy - s * dx  # the viewpoint in the frame's own axes
        x0, y0 = poses[frame, 0] - grid.x0, poses[frame, 1] - grid.y0
        for k in range(starts[frame], starts[frame + 1]):
            x, y = points[k, 0], points[k, 1]
            if normals[k, 0] * (from_x - x) + normals[k, 1] * (from_y - y) < 0.0:
                continue
            u, v = (x0 + c * x - s * y) / grid.resolution, (y0 + s * x + c * y) / grid.resolution
            if not (_HALF <= u < grid.columns - _HALF and _HALF <= v < grid.rows - _HALF):
                continue
            column, row = int(u), int(v)
            cell = np.uint64(row * grid.columns + column)
            if values[cell] > SAME:
                continue
            along, up = _KERNEL[int((u - column) * _LEVELS)], _KERNEL[int((v - row) * _LEVELS)]
            # without branches inside, so that several cells are written at once
            for i in range(_HALF - _ON, _HALF + _ON + 1):
                first = cell + np.uint64((i - _HALF) * grid.columns - _ON)
                for j in range(2 * _ON + 1):
                    at = first + np.uint64(j)
                    rises = (values[at] < ON_SURFACE) & (along[_HALF - _ON + j] * up[i] >= ON_SURFACE)
                    whose[at] = frame if rises else whose[at]
            for i in range(2 * _HALF + 1):
                first = cell + np.uint64((i - _HALF) * grid.columns - _HALF)
                for j in range(2 * _HALF + 1):
                    at, value = first + np.uint64(j), along[j] * up[i]
                    values[at] = value if value > values[at] else values[at]


@jit
def response(pose: Pose, hits: Array, field: Field, grid: Grid) -> float:
    """Mean of the field, interpolated between the centres of its cells, over a scan's points placed at a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    total = 0.0
    for k in range(hits.shape[0]):
        u = (pose[0] + c * hits[k, 0] - s * hits[k, 1] - grid.x0) / grid.resolution - 0.5
        v = (pose[1] + s * hits[k, 0] + c * hits[k, 1] - grid.y0) / grid.resolution - 0.5
        j, i = int(math.floor(u)), int(math.floor(v))
        if 0 <= i < grid.rows - 1 and 0 <= j < grid.columns - 1:
            a, b = u - j, v - i
            low = field[i, j] + a * (field[i, j + 1] - field[i, j])
            high = field[i + 1, j] + a * (field[i + 1, j + 1] - field[i + 1, j])
            total += low + b * (high - low)
    return total / max(hits.shape[0], 1)


@jit
def owner_of(pose: Pose, hits: Array, field: Field, owners: Owners, grid: Grid) -> int:
    """First quartile of the frames on whose surfaces a scan's points lie; −1 where they lie on none."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    found = np.empty(hits.shape[0], dtype=np.int64)
    count = 0
    for k in range(hits.shape[0]):
        column = int(math.floor((pose[0] + c * hits[k, 0] - s * hits[k, 1] - grid.x0) / grid.resolution))
        row = int(math.floor((pose[1] + s * hits[k, 0] + c * hits[k, 1] - grid.y0) / grid.resolution))
        if 0 <= row < grid.rows and 0 <= column < grid.columns and field[row, column] >= ON_SURFACE:
            found[count] = owners[row, column]
            count += 1
    return np.sort(found[:count])[count // 4] if count else -1


@jit
def search(
    hits: Array, prediction: Pose, information: Array, window: Window, field: Field, grid: Grid
) -> tuple[Pose, float, Array]:
    """Find the pose of the best response near a prediction; returns it, its response, and the covariance of the match.

    Parameters
    ----------
    hits : points of the scan in the robot's frame, shape (H, 2).
    information : inverse covariance of the prediction in the world's axes, shape (3, 3); 0 where nothing is known.
    """
    steps = int(round(window.reach / (STRIDE * grid.resolution)))
    turns = int(round(window.turn / window.turn_step))
    side = 2 * steps + 1
    samples = np.zeros((2 * turns + 1, side, side))
    best, best_pose = -np.inf, prediction
    cells = np.empty(hits.shape[0], dtype=np.uint64)
    values = field.reshape(-1)
    for a in range(2 * turns + 1):
        turn = (a - turns) * window.turn_step
        kept = _cells_at(hits, prediction, turn, steps * STRIDE, cells, grid)
        for i in range(side):
            sums = samples[a, i]
            for k in range(kept):
                first = cells[k] + np.uint64(STRIDE * i * grid.columns)
                for j in range(side):  # one sum for each: a single one would wait for every addition
                    sums[j] += values[first + np.uint64(STRIDE * j)]
            for j in range(side):
                sums[j] /= max(hits.shape[0], 1)
                dx, dy = (j - steps) * STRIDE * grid.resolution, (i - steps) * STRIDE * grid.resolution
                value = WEIGHT * sums[j] - 0.5 * _squared(dx, dy, turn, information)
                if value > best:
                    best = value
                    best_pose = (prediction[0] + dx, prediction[1] + dy, prediction[2] + turn)
    pose = _climb(hits, best_pose, prediction, information, window, field, grid)
    covariance = _spread(samples, pose, prediction, window, STRIDE * grid.resolution)
    return (pose[0], pose[1], wrap_angle(pose[2])), response(pose, hits, field, grid), covariance


@jit
def _cells_at(hits: Array, pose: Pose, turn: float, margin: int, cells: NDArray[np.uint64], grid: Grid) -> int:
    """Where a scan's points lie at a turned pose, as far as they stay on the field wherever a search shifts them.

    Returns how many do; `cells` are those `margin` rows and columns before theirs, numbered as in `smear`.
    """
    c, s = math.cos(pose[2] + turn), math.sin(pose[2] + turn)
    kept = 0
    for k in range(hits.shape[0]):
        column = int(math.floor((pose[0] + c * hits[k, 0] - s * hits[k, 1] - grid.x0) / grid.resolution))
        row = int(math.floor((pose[1] + s * hits[k, 0] + c * hits[k, 1] - grid.y0) / grid.resolution))
        if margin <= row < grid.rows - margin and margin <= column < grid.columns - margin:
            cells[kept] = (row - margin) * grid.columns + column - margin
            kept += 1
    return kept


@jit
def _squared(dx: float, dy: float, turn: float, information: Array) -> float:
    """Squared Mahalanobis distance of a pose from the prediction."""
    return (
        information[0, 0] * dx * dx
        + information[1, 1] * dy * dy
        + information[2, 2] * turn * turn
        + 2.0 * (information[0, 1] * dx * dy + information[0, 2] * dx * turn + information[1, 2] * dy * turn)
    )


@jit
def _value(there: Array, hits: Array, prediction: Pose, information: Array, field: Field, grid: Grid) -> float:
    """Logarithm of the likelihood of a pose, up to a constant."""
    return WEIGHT * response((there[0], there[1], there[2]), hits, field, grid) - 0.5 * _squared(
        there[0] - prediction[0], there[1] - prediction[1], there[2] - prediction[2], information
    )


@jit
def _climb(
    hits: Array, start: Pose, prediction: Pose, information: Array, window: Window, field: Field, grid: Grid
) -> Pose:
    """Climb to the top next to a sample, no farther than the next: along one coordinate after the other, ever finer.

    Both neighbours of a coordinate are looked at, and the last step is to the top of the parabola through all three:
    whoever takes the first that is better ends on the same side of every flat top, and drifts.
    """
    here, there = np.array(start), np.array(start)
    best = _value(here, hits, prediction, information, field, grid)
    step, turn = 0.5 * STRIDE * grid.resolution, 0.5 * window.turn_step
    widest = np.array([2.0 * step, 2.0 * step, 2.0 * turn])
    while True:
        last = step <= FINEST[0] and turn <= FINEST[1]
        moved = False
        for axis in range(3):
            size = turn if axis == 2 else step
            there[:] = here
            there[axis] = here[axis] - size
            below = _value(there, hits, prediction, information, field, grid)
            there[axis] = here[axis] + size
            above = _value(there, hits, prediction, information, field, grid)
            to = here[axis] + (size if above > below else -size)
            if max(below, above) > best and abs(to - start[axis]) <= widest[axis]:
                here[axis], best, moved = to, max(below, above), True
            elif last and not moved and max(below, above) <= best and below + above < 2.0 * best:
                here[axis] += 0.5 * size * (above - below) / (2.0 * best - below - above)
        if not moved:
            if last:
                return here[0], here[1], here[2]
            step, turn = 0.5 * step, 0.5 * turn


@jit
def _spread(samples: Array, pose: Pose, prediction: Pose, window: Window, resolution: float) -> Array:
    """Covariance of a match: second moments of the samples around it, an open direction given OPEN_SIGMA."""
    turns, steps = samples.shape[0] // 2, samples.shape[1] // 2
    top = samples.max()
    moments, total = np.zeros((3, 3)), 0.0
    offset = np.empty(3)
    for a in range(samples.shape[0]):
        for i in range(samples.shape[1]):
            for j in range(samples.shape[2]):
                weight = math.exp(SHARPNESS * (samples[a, i, j] - top))
                if weight < 1e-6:
                    continue
                offset[0] = prediction[0] + (j - steps) * resolution - pose[0]
                offset[1] = prediction[1] + (i - steps) * resolution - pose[1]
                offset[2] = prediction[2] + (a - turns) * window.turn_step - pose[2]
                for m in range(3):
                    for n in range(3):
                        moments[m, n] += weight * (offset[m] * offset[n])
                total += weight
    moments /= total
    moments[0, 0] += FLOOR[0] ** 2
    moments[1, 1] += FLOOR[0] ** 2
    moments[2, 2] += FLOOR[1] ** 2
    uniform = window.reach * window.reach / 3.0
    values, axes = np.linalg.eigh(moments[:2, :2].copy())
    for k in range(2):
        if values[k] > OPEN * OPEN * uniform:
            for i in range(2):
                for j in range(2):
                    moments[i, j] += OPEN_SIGMA**2 * axes[i, k] * axes[j, k]
    return moments


class Matcher:
    """Matches scans against the surfaces that key frames have seen, numbered from 0."""

    def __init__(self, reach: float) -> None:
        side = 2 * int(math.ceil((reach + LOOP.reach) / FIELD_RESOLUTION + 4))
        self._side = side
        self._field = np.zeros((side, side), dtype=np.float32)
        self._owners = np.zeros((side, side), dtype=np.int16)
        self._points, self._normals = np.empty((0, 2)), np.empty((0, 2))  # of all frames, and room for more
        self._starts = np.zeros(1, dtype=np.int64)

    def keep(self, frame: Surfaces) -> None:
        """Keep what a key frame saw: it is the next one."""
        start = self._starts[-1]
        end = start + len(frame.points)
        if end > len(self._points):
            room = ((0, end), (0, 0))
            self._points, self._normals = np.pad(self._points, room), np.pad(self._normals, room)
        self._points[start:end], self._normals[start:end] = frame.points, frame.normals
        self._starts = np.append(self._starts, end)

    def match(
        self,
        hits: Array,
        prediction: Pose,
        information: Array,
        first: int,
        poses: Array,
        window: Window = SEQUENTIAL,
    ) -> Match:
        """Match a scan against frames.

        Parameters
        ----------
        hits : of the scan's `Surfaces`, shape (H, 2).
        prediction, information : where the robot should be, and the inverse of its covariance in the world's axes,
            shape (3, 3); 0 for a search without a prior.
        first, poses : the frames' first, and the estimates of all, shape (F, 3).
        """
        grid = self._grid(prediction)
        starts = self._starts[first : first + len(poses) + 1]
        smear(self._points, self._normals, starts, poses, prediction, self._field, self._owners, grid)
        pose, response, covariance = search(hits, prediction, information, window, self._field, grid)
        frame = owner_of(pose, hits, self._field, self._owners, grid)
        return Match(pose, response, covariance, first + frame if frame >= 0 else first + len(poses) - 1)

    def _grid(self, centre: Pose) -> Grid:
        half = 0.5 * self._side * FIELD_RESOLUTION
        return Grid(self._side, self._side, FIELD_RESOLUTION, centre[0] - half, centre[1] - half)
