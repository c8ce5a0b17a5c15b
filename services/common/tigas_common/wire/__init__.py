"""Messages between the services and the page. The TypeScript types are generated from these models."""
