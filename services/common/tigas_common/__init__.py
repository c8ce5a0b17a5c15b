"""What every TIGAS service shares: wire types, errors, the certificate, settings and the `tigas` command."""
