"""The robot of the landmark worlds: its driver, and graph SLAM by iSAM2 with exact covariances."""
