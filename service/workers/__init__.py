"""Workers: the queue, recovery and supervision."""
