"""What runs on board: belief, maps, planning, SLAM and driver. Never imports what is true."""
