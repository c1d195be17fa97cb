"""Tests of the package `sshade`."""
