"""Planning on what is known of a world: a grid of clearances, A* and path shortening."""
