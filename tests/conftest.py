"""What every test shares."""

from hypothesis import settings

# Time is a benchmark's business: a busy machine must not fail a property.
settings.register_profile("project", deadline=None)
settings.load_profile("project")
