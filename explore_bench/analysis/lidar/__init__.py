"""The lidar kind of world."""
