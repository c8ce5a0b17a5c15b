"""Makes a scene's quality ladder from the bytes and errors of its own views at many sizes and JPEG qualities."""
