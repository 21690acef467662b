"""The truth: worlds, motion with noise, sensing with noise. Nothing here sees an estimate."""
