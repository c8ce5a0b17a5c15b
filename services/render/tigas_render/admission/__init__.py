"""Admission of new viewers, and the request rate of each. docs/deploy.md describes the whole policy.

A new viewer passes these checks in order, each of them cheaper than the resource it protects:

1. `connections`: QUIC connections, in total and per address, and the rate at which an address opens them. HTTP/1.1
   connections have their own limits (`tigas_common.http_server`).
2. `load`: while the process is full, new connections, sessions and POST viewers are refused.
3. `connections.Usage`: sessions and running requests per connection and per address.
4. `viewers.HttpViewers`: a POST viewer is a name at an address, and remains admitted for some time after its last
   request.
5. `viewers.RequestRate`: requests per second of each session, which `load` lowers under overload.

`limits` has the numbers that a user may set, and `load` the control loop with its constants. `viewers` bundles the
state of one process, and `edge_loads` adds up all edges for metrics, the page and a cluster's director. An admitted
request waits in the engine's queue, which is fair between addresses and has its own bounds (`engine.work_queue`).
"""
