"""The paper's experiment, repeated: sets, comparisons and the page docs/paper.md. Run by `make paper`."""
