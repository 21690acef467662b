"""What all tests share: property tests have no deadline, for a kernel may be compiled at its first call."""

from hypothesis import settings

settings.register_profile("explore-bench", deadline=None)
settings.load_profile("explore-bench")
