"""A real mapfit process, connections to it, and answers read strictly."""
