"""The paper's two experiments, from input to comparison."""
