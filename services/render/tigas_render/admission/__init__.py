"""Admission of new viewers, and the request rate of each. docs/deploy.md has the whole policy.

A new viewer passes these checks in order, each of them cheaper than the resource it protects:

1. `connections`: QUIC connections, in total and of one address, and the rate at which an address opens them. HTTP/1.1
   connections have their own limits (`tigas_common.http_server`).
2. `load`: while the process is full, new connections, sessions and viewers by POST are refused.
3. `connections.Usage`: sessions and running requests of a connection and of its address.
4. `viewers.HttpViewers`: a viewer by POST is one name at one address, and stays one for some time after its last
   request.
5. `viewers.RequestRate`: the requests of each session per second, which `load` lowers under overload.

`limits` has the numbers that a user may set, and `load` the control loop with its constants. `viewers` bundles the
state of one process, and `edge_loads` adds up all edges for metrics, the page and a cluster's director. An admitted
request waits in the engine's queue, which is fair between addresses and has its own bounds (`engine.work_queue`).
"""
