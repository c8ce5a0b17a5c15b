"""The experiment store over HTTP: accepts runs made by pages, and serves lists, reports and archives."""
