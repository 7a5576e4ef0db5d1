"""The paper's validation model: replay a log through the identified model -> estimatedmotion.npz and figures."""
