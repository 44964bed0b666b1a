/* The module `hdplan._loops`: the loops of all rooms in one binary. */

#include "../../distance/compiled/border.h"

extern PyMethodDef forward_functions[], inverse_functions[], reach_functions[], close_pairs_functions[],
    hdsdf_functions[], exact_functions[], separation_functions[], bounds_functions[], parts_functions[], newton_step_functions[],
    evaluation_functions[], time_optimal_functions[], gravity_functions[], path_speed_functions[], free_functions[],
    trees_functions[], closed_form_functions[], cells_functions[], places_functions[],
    layers_functions[], braking_functions[], barrier_safety_functions[], moment_functions[],
    lows_functions[];

PyMODINIT_FUNC PyInit__loops(void);

PyMODINIT_FUNC PyInit__loops(void) {
  static struct PyModuleDef definition = {
      PyModuleDef_HEAD_INIT, "_loops", "Loops of C: each is called by the Python module of its name.", -1, NULL, NULL,
      NULL, NULL, NULL};
  PyMethodDef* all[] = {forward_functions,    inverse_functions,    reach_functions,  close_pairs_functions,
                        hdsdf_functions,      exact_functions,      separation_functions, bounds_functions, parts_functions,
                         newton_step_functions, evaluation_functions, time_optimal_functions, gravity_functions,
                         path_speed_functions, free_functions, trees_functions,
                        closed_form_functions, cells_functions, places_functions, layers_functions,
                        braking_functions, barrier_safety_functions, moment_functions,
                        lows_functions};
  PyObject* module = PyModule_Create(&definition);
  size_t i;
  int failed = !module || add_record_type(module);
  for (i = 0; !failed && i < sizeof all / sizeof all[0]; ++i) failed = PyModule_AddFunctions(module, all[i]);
  if (!failed) return module;
  Py_XDECREF(module);
  return NULL;
}
