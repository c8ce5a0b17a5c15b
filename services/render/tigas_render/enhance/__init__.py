"""Networks that enhance scenes' low rungs: their files, and the process that trains them."""
