"""Makes a scene's quality ladder from what its own views take and lose at many sizes and JPEG qualities."""
