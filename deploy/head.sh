#!/bin/bash
# Runs the head of a cluster: Ray's head node (the arguments are its start command) and `tigas cluster up`, which is
# restarted if it exits; hosts and viewers carry on in the meantime. Ends with Ray, or on SIGTERM.
end() {
    kill $(jobs -p) 2>/dev/null
    wait
    exit "$1"
}
trap 'end 0' TERM INT
"$@" & ray=$!
until ray health-check >/dev/null 2>&1; do
    kill -0 $ray 2>/dev/null || end 1
    sleep 1
done
while kill -0 $ray 2>/dev/null; do
    tigas cluster up & wait -n $! $ray
    sleep 1
done
end 1
