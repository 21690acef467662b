"""`python -m explore_bench`: the command where it is not on the path."""

from explore_bench.cli import main

if __name__ == "__main__":
    main()
