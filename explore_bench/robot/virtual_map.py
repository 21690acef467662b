"""The virtual map: one virtual landmark a cell, whose covariance says how well the cell is mapped ([25], Eq. 1).

A pose that has a cell within range would observe a landmark at its centre with covariance J Σ Jᵀ + R; all these
observations are correlated through the pose, so they are fused by covariance intersection, in time order, starting
from the prior. With the trace-optimal weight (the paper's A-optimality) no sight ever raises a cell's trace.

Covariances of all cells have the shape (n_g, 3): the entries xx, xy, yy [m²] of each.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from explore_bench.compiled import jit
from explore_bench.geometry import Array, Grid, cells_within, room_within
from explore_bench.robot.occupancy import look_up, point_in_patch
from explore_bench.world.scenario import Scenario
from explore_bench.world.signals import HIDDEN

Constants = tuple[float, float, float, bool, bool]
"""(sensor range, bearing σ, range σ, least determinant?, first sight replaces?)"""


def constants_of(scenario: Scenario) -> Constants:
    """Constants of a scenario, as `fuse_poses` takes them."""
    return (
        scenario.sensor_range,
        *scenario.sight_sigmas,
        scenario.fusion == "determinant",
        scenario.first_sight == "replace",
    )


def prior_of(scenario: Scenario) -> Array:
    """Prior σ₀² I of a virtual landmark (xx, xy, yy) [m²], shape (3,)."""
    return np.array([1.0, 0.0, 1.0]) * scenario.virtual_sigma**2


def key_poses(poses: Array, spacing: float) -> NDArray[np.bool_]:
    """Which poses the virtual map uses: those at least `spacing` [m] along the way from the last one, shape (N,)."""
    used = np.ones(len(poses), dtype=bool)
    if spacing > 0.0:
        way = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))))
        last = 0.0
        for i in range(1, len(poses)):
            used[i] = way[i] - last >= spacing
            if used[i]:
                last = way[i]
    return used


NOTHING_HIDDEN = np.empty((0, 0, 0), dtype=np.uint8), np.empty((0, 3))
"""Patches and origins of a virtual map without occlusion."""


class VirtualMap:
    """The virtual map of a trajectory, rebuilt or extended pose by pose.

    Attributes
    ----------
    covariances : (xx, xy, yy) of every cell's virtual landmark [m²], shape (n_g, 3).
    seen : whether a cell was ever in range, shape (n_g,).
    """

    def __init__(self, scenario: Scenario) -> None:
        self._scenario = scenario
        self._constants = constants_of(scenario)
        self.covariances: Array = np.empty((scenario.cell_count, 3))
        self.seen = np.empty(scenario.cell_count, dtype=bool)
        self.clear()

    def clear(self) -> None:
        """Return to the prior σ₀² I in every cell."""
        self.covariances[:] = prior_of(self._scenario)
        self.seen[:] = False

    def copy(self) -> VirtualMap:
        """Return an independent copy."""
        other = VirtualMap(self._scenario)
        other.covariances, other.seen = self.covariances.copy(), self.seen.copy()
        return other

    def fuse(
        self,
        poses: Array,
        pose_covariances: Array,
        used: NDArray[np.bool_],
        scans: tuple[NDArray[np.uint8], Array] = NOTHING_HIDDEN,
    ) -> None:
        """Fuse further poses in time order; shapes as in `fuse_poses`."""
        fuse_poses(
            self.covariances,
            self.seen,
            poses,
            pose_covariances,
            used,
            self._scenario.grid,
            self._constants,
            *scans,
        )

    @property
    def uncertainty(self) -> float:
        """U of Eq. 1 [m²]."""
        return uncertainty(self.covariances)


@jit
def uncertainty(virtual: Array) -> float:
    """Eq. 1: U = Σ tr Σ_v over all virtual landmarks [m²]."""
    total = 0.0
    for cell in range(virtual.shape[0]):
        total += virtual[cell, 0] + virtual[cell, 2]
    return total


@jit
def fuse_poses(
    virtual: Array,
    seen: NDArray[np.bool_],
    poses: Array,
    covariances: Array,
    used: NDArray[np.bool_],
    grid: Grid,
    constants: Constants,
    patches: NDArray[np.uint8],
    origins: Array,
) -> None:
    """Fuse into the virtual map, in time order, what each used pose would see of every cell within range.

    Parameters
    ----------
    virtual : covariances, shape (n_g, 3), updated in place.
    seen : whether a cell was fused before, shape (n_g,), updated in place.
    poses, covariances : trajectory in the world frame, shapes (N, 3) and (N, 3, 3).
    used : which poses take part, shape (N,).
    constants : of `constants_of`.
    patches, origins : scans of the poses where obstacles occlude (hidden cells are not fused), shapes (N, P, P)
        and (N, 3); P = 0 where nothing is hidden.
    """
    reach, bearing_sigma, range_sigma, by_determinant, replace_first = constants
    occluded = patches.shape[1] > 0
    cells, ways = room_within(grid, reach)
    held, sights, better = np.empty((3, len(cells))), np.empty((3, len(cells))), np.empty(len(cells), dtype=np.bool_)
    for i in range(poses.shape[0]):
        if not used[i]:
            continue
        count = cells_within(grid, poses[i, 0], poses[i, 1], reach, cells, ways)
        if occluded:
            count = _not_hidden(cells[:count], ways, poses[i, 2], patches[i], origins[i], grid.resolution)
        _see(covariances[i], count, ways, bearing_sigma**2, range_sigma**2, sights)
        for k in range(count):
            held[0, k], held[1, k], held[2, k] = virtual[cells[k], 0], virtual[cells[k], 1], virtual[cells[k], 2]
        _compare(count, held, sights, better)
        for k in range(count):
            cell, b_xx, b_xy, b_yy = cells[k], sights[0, k], sights[1, k], sights[2, k]
            if replace_first and not seen[cell]:
                virtual[cell, 0], virtual[cell, 1], virtual[cell, 2] = b_xx, b_xy, b_yy
            elif by_determinant:
                _intersect_determinant(virtual[cell], b_xx, b_xy, b_yy)
            elif better[k]:
                _intersect_trace(virtual[cell], b_xx, b_xy, b_yy)
            seen[cell] = True


@jit
def _not_hidden(
    cells: NDArray[np.int64], ways: Array, heading: float, patch: NDArray[np.uint8], origin: Array, resolution: float
) -> int:
    """Move the cells in range that a scan does not hold for hidden, and the ways to them, to the front; how many."""
    count = 0
    for k in range(len(cells)):
        u, v = point_in_patch(ways[k, 0], ways[k, 1], heading, origin)
        if look_up(patch, u, v, resolution) != HIDDEN:
            cells[count], ways[count, 0], ways[count, 1] = cells[k], ways[k, 0], ways[k, 1]
            count += 1
    return count


# The next two have no branch and no call in their loops, so that they are compiled to vector instructions: most sights
# of a cell tell nothing new, and what they cost is what the virtual map costs.


@jit
def _see(sigma: Array, count: int, ways: Array, bearing2: float, range2: float, sights: Array) -> None:
    """Covariance J Σ Jᵀ + R with which a pose sees each place that lies `ways` from it [m], into columns of (3, ·)."""
    xx, xy, yy = sigma[0, 0], sigma[0, 1], sigma[1, 1]
    xh, yh, hh = sigma[0, 2], sigma[1, 2], sigma[2, 2]
    for k in range(count):
        dx, dy = ways[k, 0], ways[k, 1]
        distance2 = dx * dx + dy * dy
        # J = [1 0 −dy; 0 1 dx]; R turned from (range, bearing) into the world's axes
        along = range2 / distance2 if distance2 > 1e-12 else 0.0
        sights[0, k] = xx - 2.0 * dy * xh + dy * dy * hh + along * dx * dx + bearing2 * dy * dy
        sights[1, k] = xy + dx * xh - dy * yh - dx * dy * hh + (along - bearing2) * dx * dy
        sights[2, k] = yy + 2.0 * dx * yh + dx * dx * hh + along * dy * dy + bearing2 * dx * dx


@jit
def _compare(count: int, held: Array, sights: Array, better: NDArray[np.bool_]) -> None:
    """Say of each sight B of a cell with the covariance A whether the intersection of the least trace is not A itself.

    The derivative of the trace by ω at ω = 1 is tr(A B⁻¹ A) − tr A; while it is not positive, A alone is best.
    """
    for k in range(count):
        xx, xy, yy = held[0, k], held[1, k], held[2, k]
        b_xx, b_xy, b_yy = sights[0, k], sights[1, k], sights[2, k]
        trace = xx + yy
        square_xx, square_xy, square_yy = xx * xx + xy * xy, xy * trace, xy * xy + yy * yy
        derivative = square_xx * b_yy - 2.0 * square_xy * b_xy + square_yy * b_xx
        better[k] = not derivative <= trace * (b_xx * b_yy - b_xy * b_xy)


@jit
def _intersect_trace(a: Array, b_xx: float, b_xy: float, b_yy: float) -> None:
    """Covariance intersection (ω A⁻¹ + (1 − ω) B⁻¹)⁻¹ of 2 × 2 covariances with the ω < 1 of the least trace.

    With M = ω A⁻¹ + (1 − ω) B⁻¹ the trace of M⁻¹ is tr M / det M, linear over quadratic in ω: its derivative
    vanishes at the root of a quadratic. Scaled by det A det B, M becomes p + q ω entry by entry. `_compare` has said
    that the derivative at ω = 1 is positive.
    """
    xx, xy, yy = a[0], a[1], a[2]
    trace_a, trace_b = xx + yy, b_xx + b_yy
    det_b = b_xx * b_yy - b_xy * b_xy
    # everything below is scaled by det A det B, so that no inverse is formed and M is p + q ω entry by entry:
    # a_ is A⁻¹, o_ is B⁻¹ (M at ω = 0), d_ their difference (the slope of M)
    det_a = xx * yy - xy * xy
    # adj A / det A and adj B / det B, times det A det B
    a_xx, a_xy, a_yy = yy * det_b, -xy * det_b, xx * det_b
    o_xx, o_xy, o_yy = b_yy * det_a, -b_xy * det_a, b_xx * det_a
    d_xx, d_xy, d_yy = a_xx - o_xx, a_xy - o_xy, a_yy - o_yy
    n0, n1 = trace_b * det_a, trace_a * det_b - trace_b * det_a
    d0 = o_xx * o_yy - o_xy * o_xy
    d1 = o_xx * d_yy + o_yy * d_xx - 2.0 * o_xy * d_xy
    d2 = d_xx * d_yy - d_xy * d_xy
    # (n0 + n1 ω) / (d0 + d1 ω + d2 ω²): the numerator of its derivative is −(c0 + c1 ω + c2 ω²)
    c0, c1, c2 = n0 * d1 - n1 * d0, 2.0 * n0 * d2, n1 * d2
    if c0 <= 0.0:
        a[0], a[1], a[2] = b_xx, b_xy, b_yy
        return
    # at ω = 1 the derivative is positive (A alone is not best) and, with c0 > 0, at ω = 0 it is negative: exactly one
    # root lies between. Of its two forms, half / c2 and c0 / half, neither cancels; the one in [0, 1] is it.
    root = math.sqrt(max(c1 * c1 - 4.0 * c2 * c0, 0.0))
    half = -0.5 * (c1 + root) if c1 >= 0.0 else -0.5 * (c1 - root)
    omega = half / c2 if c2 != 0.0 else 2.0
    if not 0.0 <= omega <= 1.0:
        omega = c0 / half
    if not 0.0 <= omega <= 1.0:
        return
    m_xx, m_xy, m_yy = o_xx + d_xx * omega, o_xy + d_xy * omega, o_yy + d_yy * omega
    scale = det_a * det_b / (m_xx * m_yy - m_xy * m_xy)
    fused_xx, fused_yy = m_yy * scale, m_xx * scale
    if fused_xx + fused_yy < trace_a:
        a[0], a[1], a[2] = fused_xx, -m_xy * scale, fused_yy


@jit
def _intersect_determinant(a: Array, b_xx: float, b_xy: float, b_yy: float) -> None:
    """Covariance intersection with the ω of the least determinant, the vertex of a parabola ([8])."""
    det_a, det_b = a[0] * a[2] - a[1] * a[1], b_xx * b_yy - b_xy * b_xy
    a_xx, a_xy, a_yy = a[2] / det_a, -a[1] / det_a, a[0] / det_a
    o_xx, o_xy, o_yy = b_yy / det_b, -b_xy / det_b, b_xx / det_b
    d_xx, d_xy, d_yy = a_xx - o_xx, a_xy - o_xy, a_yy - o_yy
    d1 = o_xx * d_yy + o_yy * d_xx - 2.0 * o_xy * d_xy
    d2 = d_xx * d_yy - d_xy * d_xy
    if d2 < 0.0:
        omega = min(max(-0.5 * d1 / d2, 0.0), 1.0)
    else:
        omega = 1.0 if d1 + d2 >= 0.0 else 0.0
    m_xx, m_xy, m_yy = o_xx + d_xx * omega, o_xy + d_xy * omega, o_yy + d_yy * omega
    det = m_xx * m_yy - m_xy * m_xy
    a[0], a[1], a[2] = m_yy / det, -m_xy / det, m_xx / det
