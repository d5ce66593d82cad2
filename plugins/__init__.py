"""The plugins that come with imitor; found by walking this package."""
