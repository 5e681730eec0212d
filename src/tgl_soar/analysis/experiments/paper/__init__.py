"""The paper's experiments: on a line, in changing air, at other leans and speeds."""
