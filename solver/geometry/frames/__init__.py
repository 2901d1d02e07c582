"""Base frame, wrist centre and rigid transforms."""
