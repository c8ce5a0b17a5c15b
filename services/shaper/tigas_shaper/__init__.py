"""The last-mile router: network traces, the link that replays them, and the gateway that forwards across it."""
