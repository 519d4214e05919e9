"""Requests, jobs and crowds that mean harm, and the verdict on what the service made of them."""
