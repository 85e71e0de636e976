"""The review of doubtful buildings: photos with the block drawn over them, and decisions that are kept."""
