"""The interface of controllers, posture control (paper A), steering by velocity commands, and standing up."""
