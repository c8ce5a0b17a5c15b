"""`python -m tigas_common`: the `tigas` command, for whoever must start it with this very Python."""

from tigas_common.cli import main

if __name__ == "__main__":  # processes that the command starts import this, too
    main()
