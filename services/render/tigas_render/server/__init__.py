"""The HTTP application, its wiring into servers, and the state of the running service."""
