"""Sources of registered shapes: synthetic bodies, FAUST, TOSCA, sequences, generated shapes."""
