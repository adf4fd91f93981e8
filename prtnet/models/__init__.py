"""Networks (position, normal) -> transfer, and their training."""
