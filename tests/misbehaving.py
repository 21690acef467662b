"""Plugins that harm whoever is near, by accident or by sloppiness; nothing here is a test.

Each is a head, run when the plugin is imported, and the lines of its second and later choices.
"""

NEAREST = "return int(observation.path_lengths.argmin())"

META = """
class Nasty:
    def __repr__(self): raise {error}
    __str__ = __repr__
class NastyError(Exception):
    def __str__(self): raise {error}
    __repr__ = __str__
"""

HARMLESS = {
    "nothing wrong": ("", NEAREST),
    "changes nearest": (
        "import baselines.nearest as n\nn.Nearest.choose = lambda self, observation: 0",
        NEAREST,
    ),
    "changes the robot": (
        "from explore_bench.trial.landmark.explorer import LandmarkExplorer as E\n"
        "E.explored = property(lambda s: 1.0, lambda s, v: None)",
        NEAREST,
    ),
    "changes numpy": ("import numpy as np\nnp.argsort = lambda values, **options: np.zeros(len(values), int)", NEAREST),
    "changes a metric": (
        "from explore_bench.analysis import metrics as m\nm.METRICS.clear()\nm.trajectory_error = lambda record: 0.0",
        NEAREST,
    ),
    "changes the seeding": (
        "from explore_bench.trial import seeding as s\ns.PURPOSES = ('train', 'evaluate')",
        NEAREST,
    ),
    "changes the encoding": ("from explore_bench.records import encoding as e\ne.LEVEL = 1", NEAREST),
    "changes its scenario": ("", f"observation.scenario.__dict__['coverage'] = 0.01\n{NEAREST}"),
    "puts its own into its scenario": (
        "class Own: pass",
        f"observation.scenario.__dict__['coverage'] = observation.scenario.__dict__['size'] = Own()\n{NEAREST}",
    ),
    "opens all arrays": (
        "import numpy as np",
        "belief = observation.belief\n"
        "for array in (belief.poses, belief.known, belief.occupancy, belief.pose_covariances, *observation.paths):\n"
        "    if isinstance(array.base, np.ndarray): array.base.setflags(write=True)\n"
        "    array.setflags(write=True)\n"
        "choice = int(observation.path_lengths.argmin())\n"
        "belief.poses[:] = 0.0\n"
        "belief.known[:] = True\n"
        "return choice",
    ),
    "threads without end": (
        "import threading, time",
        f"threading.Thread(target=lambda: [time.sleep(0.01) for _ in iter(int, 1)]).start()\n{NEAREST}",
    ),
    "hangs at its end": ("import atexit, time\natexit.register(time.sleep, 600)", NEAREST),
    "ignores alarms": ("import signal\nsignal.signal(signal.SIGALRM, signal.SIG_IGN)", NEAREST),
    "forks": ("import os", f"os.fork()\n{NEAREST}"),
    "leaves a child": (
        "import os, time",
        f"if os.fork() == 0:\n    while True: time.sleep(1)\n{NEAREST}",
    ),
    "kills its parent": ("import os, signal\nos.kill(os.getppid(), signal.SIGKILL)", NEAREST),
    "stops its parent": ("import os, signal\nos.kill(os.getppid(), signal.SIGSTOP)", NEAREST),
    "changes the environment": ("import os\nos.environ.clear()\nos.chdir('/')", NEAREST),
    "prints": ("", f"import os\nprint('strategy,size' * 1000)\nos.write(1, b'strategy,size')\n{NEAREST}"),
    "changes the recursion limit": ("import sys\nsys.setrecursionlimit(60 + 200)", NEAREST),
    "an index of its own kind": (
        "class Index(int):\n    def __int__(self): raise KeyboardInterrupt\n    __index__ = __lt__ = __le__ = __int__",
        "return Index(observation.path_lengths.argmin())",
    ),
}
"""They harm at most themselves: the trial goes on to an end of its own."""

FAILING = {
    "KeyboardInterrupt": ("", "raise KeyboardInterrupt"),
    "SystemExit": ("", "raise SystemExit(0)"),
    "GeneratorExit": ("", "raise GeneratorExit"),
    "StopIteration": ("", "raise StopIteration(0)"),
    "an exception of its own": ("class Own(BaseException): pass", "raise Own"),
    "an exception that cannot be shown": (META.format(error="ValueError"), "raise NastyError"),
    "one that interrupts where it is shown": (META.format(error="KeyboardInterrupt"), "raise NastyError"),
    "an answer that cannot be shown": (META.format(error="ValueError"), "return Nasty()"),
    "one that exits where it is shown": (META.format(error="SystemExit"), "return Nasty()"),
    "a place that cannot be shown": (
        f"from explore_bench import Target\n{META.format(error='KeyboardInterrupt')}",
        "return Target(Nasty())",
    ),
    "an answer of 50 MB": ("", "return 'a' * 50_000_000"),
    "a reason of 50 MB": ("", "raise ValueError('a\\n' * 25_000_000)"),
    "an index of 9,000 digits": ("", "return 10 ** 9000"),
    "a deep recursion": ("def deep(): return deep()", "return deep()"),
    "an alien error": ("import numpy as np", "return np.linalg.inv(np.zeros((2, 2)))"),
}
"""They fail for good."""

TRANSIENT = {
    "loops": ("", "while True: pass"),
    "swallows everything": (
        "",
        "while True:\n    try:\n        while True: pass\n    except BaseException: pass",
    ),
    "swallows the time limit once": (
        "import time",
        f"try:\n    time.sleep(60)\nexcept BaseException: pass\n{NEAREST}",
    ),
    "makes another error of it": (
        "import time",
        "try:\n    time.sleep(60)\nexcept BaseException:\n    raise SystemError('a result with an exception set')",
    ),
    "loops in compiled code": (
        "import numba\n@numba.njit\ndef endless(n):\n    i = 0\n    while n: i = (i + 1) % n\n    return i",
        "return endless(7)",
    ),
    "blocks alarms": (
        "import signal",
        "signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGALRM])\nsignal.pause()",
    ),
    "sleeps with alarms ignored": (
        "import signal, time",
        "signal.signal(signal.SIGALRM, signal.SIG_IGN)\ntime.sleep(600)",
    ),
    "stops itself": ("import os, signal", "os.kill(os.getpid(), signal.SIGSTOP)\nwhile True: pass"),
    "kills itself": ("import os, signal", "os.kill(os.getpid(), signal.SIGKILL)"),
    "kills its group": ("import os, signal", "os.killpg(0, signal.SIGTERM)\nwhile True: pass"),
    "ends at once": ("import os", "os._exit(0)"),
    "crashes": ("import ctypes", "ctypes.string_at(0)"),
    "closes all files": ("import os", f"os.closerange(0, 4096)\n{NEAREST}"),
    "eats memory": ("kept = []", "while True: kept.append(bytearray(50_000_000))"),
    "eats memory in arrays": ("import numpy as np\nkept = []", "while True: kept.append(np.ones((1000, 5000)))"),
    "runs in a deadlock": ("import threading\nlock = threading.Lock()\nlock.acquire()", "lock.acquire()"),
    "interrupts when imported": ("raise KeyboardInterrupt", NEAREST),
    "exits when imported": ("raise SystemExit(3)", NEAREST),
    "ends when imported": ("import os\nos._exit(3)", NEAREST),
    "loops when imported": ("while True: pass", NEAREST),
    "stops when imported": ("import os, signal\nos.kill(os.getpid(), signal.SIGSTOP)", NEAREST),
}
"""They cannot be made, or fail for want of time or memory or with their process, and are worth another try."""
