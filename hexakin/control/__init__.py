"""The interface of controllers; posture control (paper A), steering by velocity, standing up."""
