"""The network-namespace lab: client, gateway and service on one machine, with the shaped link between them."""
