"""`python -m tigas_common`: the `tigas` command, for whoever must start it with this very Python."""

from tigas_common.cli import main

main()
