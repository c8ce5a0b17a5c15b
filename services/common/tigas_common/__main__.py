"""`python -m tigas_common`: the `tigas` command, run with this very Python."""

from tigas_common.cli import main

if __name__ == "__main__":  # processes started by the command import this as well
    main()
