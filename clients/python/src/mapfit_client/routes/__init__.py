"""What can be asked, a file a resource: each function is an exchange."""
