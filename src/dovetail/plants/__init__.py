"""Physics engines that play the arm: torques in, joint state out."""
