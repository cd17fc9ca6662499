"""The paper's tables: pictures and correspondences of many methods on one set of drawings, and what they score."""
