"""Job documents: small rooms to map, and what becomes of them when somebody means harm."""
