"""How the service is asked: exchanges that know nothing of sockets, and the two transports that carry them."""
