"""The controller: it carries a plan out, and cannot tell which backend it has."""
