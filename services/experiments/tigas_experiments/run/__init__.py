"""Execution of runs: the services, the browser, the link, and an experiment's matrix of runs."""
