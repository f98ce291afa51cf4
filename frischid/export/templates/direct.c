/* Torque of friction alone, with the sign it has in the equation of motion. */
void @robot@_friction(const double q[@ROBOT@_JOINTS], const double v[@ROBOT@_JOINTS], double tau[@ROBOT@_JOINTS])
{
    const double a[@ROBOT@_JOINTS] = {0.0};
    int j;
    (void)q, (void)v, (void)a;
    for (j = 0; j < @ROBOT@_JOINTS; j++)
        tau[j] = 0.0;
@friction@
}

/* Torque of a motion: links, rotors, friction and all other effects of the model. */
void @robot@_inverse_dynamics(const double q[@ROBOT@_JOINTS], const double v[@ROBOT@_JOINTS],
                      const double a[@ROBOT@_JOINTS], double tau[@ROBOT@_JOINTS])
{
    int j;
    for (j = 0; j < @ROBOT@_JOINTS; j++)
        tau[j] = 0.0;
    @robot@_rigid(@robot@_links, @robot@_up, q, v, a, tau);
@effects@
}
