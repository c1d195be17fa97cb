"""Puts this folder, with the tasks and rows that tests share, on the path of the tests below it."""
