"""What is asked: a task with its mesh and handles, and the options of the methods. No file and no solver."""
