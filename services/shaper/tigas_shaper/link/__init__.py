"""The shaped hop in the kernel: a gateway that forwards, and a link with a rate, a queue, delay, jitter and loss."""
