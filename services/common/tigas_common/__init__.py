"""Code shared by all TIGAS services: wire types, errors, the certificate, settings and the `tigas` command."""
