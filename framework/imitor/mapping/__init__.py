"""What mappers share: the scaled body, the feet on the floor, frames of the trunk from points."""
