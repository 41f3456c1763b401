"""What a robot is: its model, and its files in and out."""
