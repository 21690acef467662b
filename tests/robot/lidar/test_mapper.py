"""The mapper: its virtual map is the one of its poses and scans, and a belief is frozen."""

import dataclasses

import numpy as np
import pytest
from lidar_worlds import cluttered, drawn, ranges_at, way_through

from explore_bench.geometry import between
from explore_bench.robot.belief import peak_traces
from explore_bench.robot.lidar.decision_grid import known, occupancy, patch_reach, seen_patch
from explore_bench.robot.lidar.mapper import Mapper
from explore_bench.robot.virtual_map import VirtualMap, prior_of
from explore_bench.world.lidar.constants import LidarScenario
from explore_bench.world.signals import RangeScan

SCENARIO = LidarScenario(size=10.0, sensor_range=4.0)
POSES = way_through((1.0, 5.0), (8.0, 5.0))
WORLD = cluttered(10.0, 12, 3, [pose[:2] for pose in POSES])


def scan_at(pose):
    return RangeScan(ranges_at(WORLD, pose, reach=SCENARIO.sensor_range))


def mapped(poses=POSES, scenario=SCENARIO):
    mapper = Mapper(scenario, poses[0], scan_at(poses[0]))
    for number in range(1, len(poses)):
        advance(mapper, poses, number)
    return mapper


def advance(mapper, poses, number):
    motion = between(poses[number - 1], poses[number])
    return mapper.update(motion, abs(motion[0]), abs(motion[2]), scan_at(poses[number]))


def rebuilt(mapper, poses, scenario=SCENARIO):
    """Virtual map of all poses as they are now."""
    virtual = VirtualMap(scenario)
    reach = patch_reach(scenario)
    patches = np.stack([seen_patch(scan_at(p).ranges, scenario.sensor_range, scenario.cell_size, reach) for p in poses])
    middle = (reach + 0.5) * scenario.cell_size
    origins = np.tile((middle, middle, 0.0), (len(poses), 1))
    used = np.ones(len(poses), dtype=bool)
    virtual.fuse(mapper.slam.poses, mapper.slam.covariances, used, (patches, origins))
    return virtual


def test_the_virtual_map_is_the_one_of_all_poses_and_scans():
    """Pose by pose between two refreshes, and anew at each, it ends the same as one built from nothing."""
    for count in (1, 4, 11, 12, len(POSES)):
        mapper = mapped(POSES[:count])
        expected = rebuilt(mapper, POSES[:count])
        np.testing.assert_allclose(mapper.virtual_map.covariances, expected.covariances, rtol=1e-9, atol=1e-15)
        np.testing.assert_array_equal(mapper.virtual_map.seen, expected.seen)
        assert mapper.peak_traces == pytest.approx(peak_traces(mapper.slam.covariances))


def test_what_a_wall_hides_keeps_its_prior():
    """A room with a closed door: the cells behind the wall are in range and stay as uncertain as ever."""
    world = drawn(10.0, (4.0, 4.2, 0.0, 10.0))
    pose = (2.0, 5.0, 0.0)
    mapper = Mapper(SCENARIO, pose, RangeScan(ranges_at(world, pose, reach=4.0)))
    virtual = mapper.belief().virtual_map
    np.testing.assert_allclose(virtual[:, 3:], np.broadcast_to(prior_of(SCENARIO), (5, 2, 3)))
    assert (virtual[1:4, 0, 0] < 0.01).all()


def test_poses_that_are_skipped_fuse_nothing():
    spaced = SCENARIO.replace(key_pose_spacing=100.0)
    one, many = mapped(POSES[:1], spaced), mapped(POSES, spaced)
    np.testing.assert_array_equal(one.virtual_map.seen, many.virtual_map.seen)
    assert mapped(POSES).virtual_map.seen.sum() > many.virtual_map.seen.sum()


def test_a_belief_is_what_the_mapper_knows_now():
    mapper = mapped()
    belief = mapper.belief()
    np.testing.assert_array_equal(belief.poses, mapper.slam.poses)
    np.testing.assert_array_equal(belief.pose_covariances, mapper.slam.covariances)
    np.testing.assert_array_equal(belief.occupancy, occupancy(mapper.slam.map, SCENARIO))
    np.testing.assert_array_equal(belief.known, known(mapper.slam.map, SCENARIO))
    assert belief.uncertainty == pytest.approx(belief.virtual_traces.sum())
    assert belief.peak_trace == mapper.peak_traces[0]
    assert belief.landmarks.shape == (0, 2)
    assert len(belief.graph.links) == len(mapper.slam.links)
    for shown, own in zip(belief.graph.links, mapper.slam.links, strict=True):
        assert shown._replace(covariance=0) == own._replace(covariance=0)
        np.testing.assert_array_equal(shown.covariance, own.covariance)
    assert belief.fine is belief.graph.fine
    assert belief.fine.grid == SCENARIO.map_grid
    np.testing.assert_array_equal(belief.fine.occupied, mapper.slam.map.occupied)
    np.testing.assert_array_equal(belief.fine.known, mapper.slam.map.known)


def arrays_of(belief):
    fields = {field.name: getattr(belief, field.name) for field in dataclasses.fields(belief)}
    fields |= {"fine known": belief.fine.known, "fine occupied": belief.fine.occupied}
    return {name: part for name, part in fields.items() if isinstance(part, np.ndarray)}


def test_later_scans_leave_a_belief_untouched_and_no_one_else_can_touch_it():
    mapper = mapped(POSES[:8])
    belief = mapper.belief()
    before = {name: part.copy() for name, part in arrays_of(belief).items()}
    links = belief.graph.links
    for number in range(8, len(POSES)):
        advance(mapper, POSES, number)
    for name, part in arrays_of(belief).items():
        assert not part.flags.writeable, name
        np.testing.assert_array_equal(part, before[name], err_msg=name)
    assert belief.graph.links == links
    assert (mapper.belief().known != belief.known).any()
