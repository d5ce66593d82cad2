"""Pipelines as text: YAML with line numbers, validated into a specification or refused with every problem."""
