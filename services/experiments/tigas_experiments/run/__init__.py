"""Making runs: the services, the browser, the link, and the matrix of an experiment."""
