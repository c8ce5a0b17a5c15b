"""Messages between the store and the page, and the records and configurations of runs."""
