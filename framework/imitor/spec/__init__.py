"""Pipelines as text: YAML with line numbers, validated into a specification or refused with every problem."""

from imitor.spec.load import load_pipeline, load_source, load_text
from imitor.spec.schema import PipelineSpec, StageSpec

__all__ = ["PipelineSpec", "StageSpec", "load_pipeline", "load_source", "load_text"]
