"""Where registered shapes come from: synthetic bodies, FAUST, TOSCA, sequences."""
