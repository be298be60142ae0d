"""FleetSpec, Mission and EdgeNode: models, validation, custom resource definitions, reference."""
