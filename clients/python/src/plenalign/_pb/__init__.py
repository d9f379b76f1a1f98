"""The WebSocket's binary messages, by protoc."""
