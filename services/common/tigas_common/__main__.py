"""The `tigas` command, run by the current interpreter: `python -m tigas_common`."""

from tigas_common.cli import main

if __name__ == "__main__":  # child processes import this module too
    main()
