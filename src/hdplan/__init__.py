"""hdplan: motion planning for robot arms, proven against the real meshes."""
