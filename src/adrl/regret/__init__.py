"""adrl regret: how far methods are behind the best one, over cells that differ in expert, reward, place and robot."""
