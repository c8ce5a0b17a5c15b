"""One reader for each format that network recordings are published in; `formats` chooses among them."""
