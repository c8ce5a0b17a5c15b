"""The network-namespace lab: client, gateway and service on one machine, connected by the shaped link."""
